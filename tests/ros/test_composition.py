"""Several programs' nodes in one process behave as in separate processes, and end together."""

import json
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders
from rcl_interfaces.srv import ListParameters
from std_srvs.srv import Trigger

from obk_cli.launch.console import NodeLines

from .composed import NODES, Composed, Entry, client_context, entry, started_module
from .stack import DUMMY, eventually, obk

pytestmark = pytest.mark.ros


@pytest.fixture
def compose(tmp_path: Path) -> Iterator[Callable[..., Composed]]:
    """Start composed processes whose module `nodes` is NODES."""
    (tmp_path / "nodes.py").write_text(NODES)
    with client_context() as made:

        def start(*entries: Entry) -> Composed:
            specification = tmp_path / "composed.json"
            specification.write_text(json.dumps({"nodes": entries}))
            made.append(
                Composed(started_module(["obelisk_py.core.composition", specification], tmp_path))
            )
            return made[-1]

        yield start


@pytest.mark.mujoco
def test_the_dummy_stack_runs_in_one_process(
    compose: Callable[..., Composed], tmp_path: Path
) -> None:
    params = tmp_path / "params.yaml"
    assert obk("compile", DUMMY, "--to", "params", "--output", params).returncode == 0
    modules = {
        "/obelisk_robot_0": "obelisk_py.core.sim.mujoco",
        "/obelisk_estimation_0": "obelisk_py.zoo.estimation",
        "/obelisk_control_0": "obelisk_py.zoo.control.example",
    }
    composed = compose(
        *(entry(n, None, "--params-file", str(params), module=m) for n, m in modules.items())
    )
    composed.activate(*modules)
    for kind, topic in (
        (JointEncoders, "/obelisk/dummy/joint_encoders"),
        (EstimatedState, "/obelisk/dummy/est"),
        (PositionSetpoint, "/obelisk/dummy/ctrl"),
    ):
        eventually(composed.listen(kind, topic), topic, seen=lambda: composed.text)
    for node, own in (
        ("/obelisk_robot_0", "mujoco_setting"),
        ("/obelisk_estimation_0", "timer_est_setting"),
        ("/obelisk_control_0", "timer_ctrl_setting"),
    ):
        answer = composed.ask(ListParameters, f"{node}/list_parameters", ListParameters.Request())
        names = set(answer.result.names)
        assert names >= {own, "params_path"}
        assert len(names & {"mujoco_setting", "timer_est_setting", "timer_ctrl_setting"}) == 1
    assert composed.end(signal.SIGINT) == 0, composed.text


def test_ros_arguments_hold_for_their_node_only(
    compose: Callable[..., Composed], tmp_path: Path
) -> None:
    params = tmp_path / "params.yaml"
    params.write_text(
        "/left/arm: {ros__parameters: {gain: 1}}\n/right/arm2: {ros__parameters: {gain: 2}}\n"
    )
    both = ("--params-file", str(params))
    composed = compose(
        entry("/left/arm", "main", *both, "-r", "in:=/x", "--log-level", "debug", "--", "tag1"),
        entry("/right/arm2", "held", *both, "--", "tag2"),
        entry("/arm3", None),
    )
    composed.activate("/left/arm", "/right/arm2", "/arm3")
    assert composed.end(signal.SIGTERM) == 0, composed.text
    reported = [line for line in composed.lines if line.startswith("arm")]
    assert reported[:9] == [
        *("arm 1", "arm /x", "arm tag1"),
        *("arm2 2", "arm2 /right/in", "arm2 tag2"),
        *("arm3 0", "arm3 /in", "arm3 __node:=arm3"),
    ]
    details = [line for line in composed.lines if "a detail" in line]
    assert [line.rpartition("] ")[2] for line in details] == ["[left.arm]: a detail"]


def test_a_signal_stops_all_cleanly_and_lets_the_programs_finish(
    compose: Callable[..., Composed],
) -> None:
    composed = compose(entry("/a", "held"), entry("/b"))
    composed.activate("/a", "/b")
    assert composed.end(signal.SIGINT) == 0, composed.text
    way_down = ["b deactivated", "b shut down", "a deactivated", "a shut down"]
    assert [line for line in composed.lines if line in {"opened", *way_down, "closed"}] == [
        *("opened", *way_down, "closed")
    ]


def test_a_callback_that_raises_fails_only_its_node(compose: Callable[..., Composed]) -> None:
    composed = compose(entry("/a"), entry("/b", "raising"))
    composed.activate("/a")
    composed.set_off("/b")
    eventually(lambda: composed.state("/b") == "unconfigured", "error processing")
    assert composed.state("/a") == "active"
    answer = composed.ask(Trigger, "/b/last_error", Trigger.Request())
    assert answer.message.startswith("Raising.act: ValueError: no such motor\nTraceback")
    assert composed.end(signal.SIGINT) == 0, composed.text
    lines = NodeLines(["/a", "/b"])
    reported = [line.strip() for line in composed.lines if lines.owner(line) == "/b"]
    assert reported[0].endswith("[b]: Raising.act: ValueError: no such motor")
    assert "ValueError: no such motor" in reported[1:]


@pytest.mark.parametrize(
    ("function", "cause"),
    [
        ("dying", "on_error: RuntimeError: nor is there a brake"),
        ("leaving", "a callback: SystemExit: 0"),
    ],
)
def test_a_node_that_cannot_continue_ends_the_process_and_is_named(
    compose: Callable[..., Composed], function: str, cause: str
) -> None:
    composed = compose(entry("/a"), entry("/b", function), entry("/c"))
    composed.activate("/a", "/c")
    composed.set_off("/b")
    assert composed.end() == 1
    for node in "ac":
        assert f"{node} deactivated" in composed.lines
        assert f"{node} shut down" in composed.lines
    assert composed.lines[-1] == f"/b: {cause}"


@pytest.mark.parametrize(
    ("function", "cause"),
    [
        ("forgetful", "nodes:forgetful(): the program ended without calling spin_obelisk"),
        ("broken", "nodes:broken(): KeyError: 'no_such_key'"),
        (
            "own",
            "nodes:own(): RuntimeError: Context.init() must only be called once; in a "
            "composed process, spin_obelisk creates the ROS context and spins the nodes",
        ),
        ("absent", "nodes:absent(): AttributeError: module 'nodes' has no attribute "),
        ("unmade", "the node cannot be created: ValueError: no such port"),
    ],
)
def test_if_one_node_cannot_be_created_none_runs_and_it_is_named(
    compose: Callable[..., Composed], function: str, cause: str
) -> None:
    composed = compose(entry("/a", "held"), entry("/b", function), entry("/c"))
    assert composed.end() == 1
    assert composed.lines[-1].startswith(f"/b: {cause}")
    assert [line for line in composed.lines if line in ("opened", "closed")] == ["opened", "closed"]
    assert any(f"[b]: {cause[:30]}" in line for line in composed.lines)


def test_a_missing_module_is_reported_for_its_node(
    compose: Callable[..., Composed],
) -> None:
    composed = compose(entry("/a"), entry("/b", None, module="no_such"))
    assert composed.end() == 1
    assert composed.lines[-1] == ("/b: python -m no_such: ImportError: No module named no_such")


def test_invalid_ros_arguments_are_reported_for_their_node(
    compose: Callable[..., Composed],
) -> None:
    composed = compose(entry("/a"), entry("/b", "main", "-p", "gain"))
    assert composed.end() == 1
    assert composed.lines[-1].startswith("/b: the node cannot be created: RCLInvalidROSArgsError")


def test_a_stuck_process_dumps_its_stack_on_a_signal_and_ends_at_the_second_end_signal(
    compose: Callable[..., Composed],
) -> None:
    composed = compose(entry("/a"), entry("/b", "stuck"))
    composed.activate("/a")
    composed.set_off("/b")
    composed.wait_for_line("b stuck")
    composed.process.send_signal(signal.SIGUSR1)
    composed.wait_for_line("in act")
    composed.process.send_signal(signal.SIGINT)
    assert composed.end(signal.SIGTERM) != 0


def test_a_process_of_one_node_dumps_its_stack_too(tmp_path: Path) -> None:
    (tmp_path / "nodes.py").write_text(NODES)
    arguments = ["--ros-args", "-r", "__node:=b"]
    with client_context() as made:
        made.append(Composed(started_module(["nodes", *arguments], tmp_path)))
        made[0].activate("/b")
        made[0].process.send_signal(signal.SIGUSR1)
        made[0].wait_for_line("in spin_obelisk")
        assert made[0].end(signal.SIGINT) == 0, made[0].text
