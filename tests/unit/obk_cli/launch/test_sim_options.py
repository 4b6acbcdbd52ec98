"""Options of a launch for its simulated robots."""

from dataclasses import replace

import pytest

from obk_cli.errors import MisuseError
from obk_cli.launch.options import with_simulator_parameters
from obk_cli.launch.process_groups import share_of
from obk_cli.plan.plan import Plan, PlannedNode

from ..plans import node  # noqa: TID252 - shared by folders of tests

WEB = {"viewer": "web"}


def process(section: str, *, device: str = "onboard", model: str | None = None) -> PlannedNode:
    name = f"obelisk_{section}_{device}"
    parameters = {"viewer": "none", "gain": 2.0}
    return node(name, section, device=device, parameters=parameters, model=model)


ROBOT = process("robot", model="arm.xml")
CONTROL = process("control", device="pc")


def test_only_simulated_robots_get_the_parameters() -> None:
    second = replace(ROBOT, node="second")
    plan = Plan(name="s", nodes=(ROBOT, CONTROL, second))
    changed = with_simulator_parameters(plan, share_of(plan, None), WEB, "--viewer web")
    assert [node.parameters["viewer"] for node in changed.nodes] == ["web", "none", "web"]
    assert changed.nodes[0].parameters["gain"] == 2.0


def test_without_parameters_a_plan_without_a_simulated_robot_is_fine() -> None:
    plan = Plan(name="s", nodes=(CONTROL,))
    assert with_simulator_parameters(plan, share_of(plan, None), {}, "") is plan


def test_a_stack_without_a_simulated_robot_is_rejected() -> None:
    plan = Plan(name="s", nodes=(replace(ROBOT, model=None), CONTROL))
    with pytest.raises(MisuseError) as raised:
        with_simulator_parameters(plan, share_of(plan, None), WEB, "--viewer web")
    assert str(raised.value) == "`--viewer web`: no simulated robot in `s`"
    assert raised.value.help is not None
    assert "`sim` block" in raised.value.help


def test_a_simulated_robot_on_another_device_does_not_count() -> None:
    plan = Plan(name="s", nodes=(ROBOT, CONTROL))
    with pytest.raises(MisuseError, match="no simulated robot on pc"):
        with_simulator_parameters(plan, share_of(plan, "pc"), WEB, "--viewer web")
