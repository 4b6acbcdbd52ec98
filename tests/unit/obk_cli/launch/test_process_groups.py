"""The part of a stack that a launch runs."""

from obk_cli.launch.process_groups import Share, devices_of, share_of, units_of
from obk_cli.plan.plan import Plan

from .world import process

PLAN = Plan(
    name="s",
    nodes=(process("robot"), process("control", device="pc"), process("viz", device="pc")),
)


def test_without_a_device_everything_runs_here_and_leads_itself() -> None:
    assert share_of(PLAN, None) == Share(devices=frozenset({"onboard", "pc"}), is_part=False)


def test_the_device_with_the_controller_leads() -> None:
    assert share_of(PLAN, "pc").leads
    assert share_of(PLAN, "onboard") == Share(
        devices=frozenset({"onboard"}), is_part=True, leads=False
    )


def test_without_a_controller_the_first_device_leads() -> None:
    plan = Plan(name="s", nodes=(process("robot"), process("viz", device="pc")))
    assert share_of(plan, "onboard").leads
    assert not share_of(plan, "pc").leads


def test_another_device_may_be_reported_as_lead() -> None:
    assert share_of(PLAN, "onboard", "onboard").leads
    assert not share_of(PLAN, "pc", "onboard").leads


def test_a_stack_of_one_device_is_whole_on_it() -> None:
    one = Plan(name="s", nodes=(process("robot"),))
    assert devices_of(one) == ("onboard",)
    assert not share_of(one, "onboard").is_part


def test_only_the_nodes_of_the_devices_here_are_started() -> None:
    names = [unit.name for unit in units_of(PLAN, devices={"pc"})]
    assert names == ["/obelisk_control_0", "/obelisk_viz_0"]
