"""The launch file, run with fakes of launch and launch_ros."""

from pathlib import Path

import pytest

from obelisk_spec.yaml_core import load_yaml_core
from obk_cli.emit.launch_file import emit_launch_file
from obk_cli.emit.params import emit_params
from obk_cli.plan.plan import Plan

from .plans import loop, node
from .stand_in import LifecycleNode, OnStateTransition, World, run_launch_file

NAMES = ["/obelisk_robot_a", "/left/obelisk_robot_b", "/obelisk_estimation_0", "/obelisk_control_0"]


def test_every_node_is_started_with_the_plans_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = run_launch_file(emit_launch_file(loop()), tmp_path, monkeypatch)
    assert [n.node_name for n in world.nodes] == [*NAMES, "/obelisk_joystick"]
    assert [isinstance(n, LifecycleNode) for n in world.nodes] == [True] * 4 + [False]
    left = world.nodes[1]
    assert (left.package, left.executable, left.namespace) == ("demo", "run", "/left")
    assert left.remappings == [("/a", "/b")]
    assert left.ros_arguments == ["--log-level", "debug"]
    assert left.additional_env == {"A": "1"}
    assert left.on_exit.reason == "/left/obelisk_robot_b ended"


def test_all_tiers_configure_before_the_first_activates_robot_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = run_launch_file(emit_launch_file(loop()), tmp_path, monkeypatch)
    assert world.states == [
        *((name, "inactive") for name in NAMES),
        *((name, "active") for name in NAMES),
    ]
    assert world.shutdown is None


@pytest.mark.parametrize("state", ["inactive", "errorprocessing"])
def test_a_node_that_does_not_get_active_ends_the_launch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    text = emit_launch_file(loop())
    world = run_launch_file(text, tmp_path, monkeypatch, obelisk_estimation_0=state)
    assert world.shutdown == "/obelisk_estimation_0 did not become active"
    assert ("/obelisk_control_0", "active") not in world.states


def test_later_requests_start_nothing_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = run_launch_file(emit_launch_file(loop()), tmp_path, monkeypatch)
    robot = world.nodes[0]
    for handler in world.handlers:
        if handler.target_lifecycle_node is robot:
            replay(world, handler)
    assert world.events == []
    assert world.shutdown is None


def replay(world: World, handler: OnStateTransition) -> None:
    for entity in handler.entities:
        world.visit(entity)


def test_the_nodes_get_the_parameters_that_params_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = loop()
    world = run_launch_file(emit_launch_file(plan), tmp_path, monkeypatch)
    (path,) = {path for node in world.nodes for path in node.parameters}
    assert Path(path).parent == tmp_path
    written = load_yaml_core(Path(path).read_text(encoding="utf-8"))
    assert written == load_yaml_core(emit_params(plan.nodes))
    assert written["/obelisk_robot_a"]["ros__parameters"] == {"text": "it's '''"}


@pytest.mark.parametrize(
    "name", ['"""', "'''", "\"'''", "\\", "a\nb", "${x}", "{x} %s", "../../x", "ä😀"]
)
def test_no_text_of_the_user_becomes_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    robot = node("robot", parameters={"x": name}, env={"X": name}, executable=name)
    text = emit_launch_file(Plan(name=name, nodes=(robot,)))
    (started,) = run_launch_file(text, tmp_path, monkeypatch).nodes
    assert (started.executable, started.additional_env) == (name, {"X": name})
    (path,) = map(Path, started.parameters)
    assert path.parent == tmp_path
    read = load_yaml_core(path.read_text(encoding="utf-8"))
    assert read == {"/obelisk_robot_0": {"ros__parameters": {"x": name}}}
