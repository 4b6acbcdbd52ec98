"""Stacks without MuJoCo in lockstep: programs, robots, faults, restarts and fakes."""

import functools
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import JointEncoders
from rcl_interfaces.srv import GetParameters, SetParameters

from obelisk_py.core.lockstep import guest_thread
from obelisk_py.core.lockstep.scheduler import LockstepError
from obk_cli.errors import CommandFailedError
from obk_cli.launch import commands
from obk_cli.launch.commands import Command
from obk_cli.plan.plan import PlannedNode
from obk_testing import programs
from obk_testing.programs import LoadedStacks, load_stack
from obk_testing.trial import Schedule, StackTrial

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).parent / "workspace" / "hazards.yaml"
CTRL = "/hazards/ctrl"
CONTROL, ESTIMATION, ROBOT = "/obelisk_control_0", "/obelisk_estimation_0", "/obelisk_robot_0"

Start = Callable[..., StackTrial]


@pytest.fixture
def start(start_config: Start) -> Start:
    """Start trials of the config, with changes."""
    return functools.partial(start_config, CONFIG)


def test_components_of_the_config_run_on_simulated_time(start: Start) -> None:
    run = start().run(0.5)
    views = run["/hazards/views"].data
    assert len(views) == 50
    np.testing.assert_allclose(
        views[:, 0], views[:, 1], atol=1e-12
    )  # self.t and `from time import ...`
    np.testing.assert_allclose(views[:, 0], np.arange(1, 51) * 0.01, atol=1e-9)
    assert views[-1, 2] > 0.1  # the loop is closed
    assert not run.faults
    assert not run.notes


def test_a_trial_that_cannot_begin_leaves_no_thread(start: Start) -> None:
    start()  # the loaded stack keeps threads for further trials
    before = set(threading.enumerate())
    with pytest.raises(LookupError):
        start(parameters={"nobody": {}})
    assert set(threading.enumerate()) == before


def test_warnings_about_overrides_are_notes(start: Start) -> None:
    (note,) = start("control.params.fualt=compute").run(0.1).notes
    assert "OBK409" in note
    assert "control.params.fualt=compute" in note
    assert not start("control.params.fault='none'").run(0.1).notes


def test_variants_of_a_stack_have_their_own_warnings() -> None:
    stacks = LoadedStacks()
    try:
        counts = [
            len(stacks.get(CONFIG, [f"control.params.{name}=none"]).warnings)
            for name in ("fault", "fualt", "fault")
        ]
    finally:
        stacks.close()
    assert counts == [0, 1, 0]


VIEWS = """
import sys
from pathlib import Path
from obelisk_py.core.lockstep.interception import intercepted
with intercepted():
    from obk_testing.programs import load_stack
    from obk_testing.trial import StackTrial
    stack = load_stack(Path(sys.argv[1]))
    with StackTrial(stack, seed=3) as trial:
        print(*trial.run(0.1)["/hazards/views"].data[-1, 3:])
    stack.close()
"""


def test_global_random_generators_are_reset_for_each_trial(start: Start) -> None:
    def views(seed: int) -> list[str]:
        return [*map(str, start(seed=seed).run(0.1)["/hazards/views"].data[-1, 3:])]

    here = views(3)
    assert views(4)[:2] != here[:2]
    assert views(3) == here
    words = [sys.executable, "-c", VIEWS, str(CONFIG)]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout.split() == here


@pytest.mark.parametrize("loop", ["sleep", "wait", "existing"])
def test_a_simulator_with_its_own_thread_is_a_guest(start: Start, loop: str) -> None:
    digests = set()
    for _ in range(2):
        trial = start(parameters={ROBOT: {"loop": loop}})
        run = trial.run(0.3)
        assert len(run["/hazards/joint_encoders"]) == 61
        assert not run.faults
        assert not run.notes
        digests.add(run.digest())
        trial.close()
    assert len(digests) == 1
    assert "simulator" not in [thread.name for thread in threading.enumerate()]


def test_a_simulator_that_never_sleeps_is_an_error_with_its_stack(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guest_thread, "LONGEST_TURN_S", 0.5)
    trial = start(parameters={ROBOT: {"loop": "busy"}}, record=())
    with pytest.raises(LockstepError, match=r"`simulator` of /obelisk_robot_0(.|\n)*run_simulator"):
        trial.run(0.1)


def test_a_simulator_that_raises_fails_its_node(start: Start) -> None:
    trial = start(parameters={ROBOT: {"loop": "raise"}})
    run = trial.run(0.3)
    assert trial.nodes[ROBOT].state_label == "unconfigured"
    (fault,) = run.faults
    assert "the simulation diverges" in fault
    assert "robots.py" in fault


def test_a_callback_that_raises_is_a_fault_with_its_location(start: Start) -> None:
    trial = start(parameters={CONTROL: {"fault": "compute"}})
    run = trial.run(1.0)
    assert trial.nodes[CONTROL].state_label == "unconfigured"
    assert trial.nodes[ESTIMATION].state_label == "active"
    (fault,) = run.faults
    assert fault.startswith(CONTROL)
    assert "ValueError: on purpose" in fault
    assert "controller.py" in fault
    assert len(run["/hazards/ctrl"]) == 49
    assert any("on purpose" in entry.text for entry in run.log)


def test_a_node_that_cannot_be_configured_ends_the_bring_up(start: Start) -> None:
    with pytest.raises(LockstepError, match=r"/obelisk_control_0 did not configure.*not today"):
        start(parameters={CONTROL: {"fault": "configure"}})


def test_hardware_is_rejected_before_a_node_is_created(start: Start) -> None:
    with pytest.raises(CommandFailedError, match="/obelisk_robot_0 is hardware"):
        start("robot.is_simulated=false")


def test_a_robot_that_is_no_simulator_is_rejected_unless_the_config_declares_it(
    start: Start,
) -> None:
    with pytest.raises(LockstepError, match=r"/obelisk_robot_0 \(Drive\) is not a simulator"):
        start("robot.executable=drive")
    from hazards_py.robots import open_drives  # found after its program is loaded

    assert not open_drives
    trial = start("robot.executable=drive", "robot.is_simulated=true")
    assert len(trial.run(0.1)["/hazards/joint_encoders"]) == 20


def test_a_node_that_cannot_run_in_lockstep_is_named_with_a_hint(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    def is_composable(process: PlannedNode, command: Command) -> bool:
        return process.section != "control" and commands.is_composable(process, command)

    monkeypatch.setattr(programs, "is_composable", is_composable)
    with pytest.raises(CommandFailedError, match=r"/obelisk_control_0 \(hazards_py/con") as error:
        start("control.params.fault=none")
    assert "without=['/obelisk_control_0']" in str(error.value.help)
    assert not start("control.params.fault=none", without=("control",)).run(0.1).faults


def test_environment_variables_of_a_node_are_noted(start: Start) -> None:
    run = start("control.env.SPEED=fast").run(0.01)
    (note,) = run.notes
    assert "/obelisk_control_0" in note
    assert "SPEED" in note


def test_no_other_participant_sees_the_nodes(start: Start) -> None:
    start().run(0.05)
    look = (
        "import rclpy, time; rclpy.init(); node = rclpy.create_node('look'); time.sleep(1.0);"
        "print(sorted(node.get_node_names()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", look],
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    assert "obelisk_control_0" not in done.stdout
    assert "look" in done.stdout


def test_a_plain_node_in_a_program_is_an_error(start: Start) -> None:
    with pytest.raises(LockstepError, match=r"plain rclpy node `helper` \(.*programs\.py:\d+\)"):
        start("control.executable=helper")


def test_a_program_without_a_node_is_an_error(start: Start) -> None:
    with pytest.raises(CommandFailedError, match="ended without calling spin_obelisk"):
        start("control.executable=no_spin")


def test_a_program_that_never_reaches_its_node_is_an_error(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(programs, "_LOAD_S", 1.0)
    with pytest.raises(CommandFailedError, match="has not called spin_obelisk within 1 s"):
        start("control.executable=waits")


def test_a_stub_replaces_a_node(start: Start) -> None:
    trial = start(without=("estimation",))

    def estimate(message: JointEncoders) -> dict[str, Any]:
        return {"/hazards/est": EstimatedState(q_joints=[message.y[0] + 1.0])}

    trial.stub("/stand_in", on="/hazards/joint_encoders", do=estimate, kind=JointEncoders)
    run = trial.run(0.1)
    assert run["/hazards/views"].data[-1, 2] >= 1.0
    assert not run.faults


@pytest.mark.parametrize(
    ("published", "error"),
    [
        ({"/hazards/ets": EstimatedState()}, LookupError),
        ({"/hazards/est": PositionSetpoint()}, TypeError),
    ],
)
def test_a_stub_publishes_topics_of_the_stack(
    start: Start, published: dict[str, Any], error: type[Exception]
) -> None:
    trial = start(without=("estimation",))
    trial.stub("/stand_in", "/hazards/joint_encoders", lambda _: published, JointEncoders)
    with pytest.raises(error, match="/hazards/est"):
        trial.run(0.1)


def test_a_stub_publishes_a_topic_of_nodes_that_are_left_out(start: Start) -> None:
    trial = start(without=("control", "estimation"), record=["/hazards/est"])
    sent = {"/hazards/est": EstimatedState()}
    trial.stub("/stand_in", "/hazards/joint_encoders", lambda _: sent, JointEncoders)
    assert len(trial.run(0.1)["/hazards/est"]) > 0


@pytest.mark.parametrize(
    ("action", "expected"),
    [("hold", []), ("zero", [(0.56, 0.0)]), ("damp", [(0.56, "damped")])],
)
def test_old_commands_are_acted_on_at_the_simulated_time(
    start: Start, action: str, expected: list[Any]
) -> None:
    settings = ("max_age_sec=0.06", f"stale_action={action}")
    trial = start(*(f"robot.subscribers[0].{each}" for each in settings))
    trial.run(0.5)
    trial.kill("control")
    applied = trial.nodes[ROBOT].applied
    count = len(applied)
    run = trial.run(1.0)
    assert [(round(t, 6), what) for t, what in applied[count:]] == expected
    assert any("0.5" in entry.text for entry in run.log if entry.severity >= 30)


def test_freeze_delays_and_kill_ends_a_node(start: Start) -> None:
    trial = start()
    trial.run(0.2)
    trial.freeze("control", 0.1)
    trial.run(0.2)
    trial.kill("control")
    times = trial.run(0.2)["/hazards/ctrl"].t
    np.testing.assert_allclose(times[19:22], [0.2, 0.3, 0.31], atol=1e-9)
    assert times[-1] == pytest.approx(0.4)


@pytest.mark.parametrize("node", ["control", "estimation", "robot"])
def test_a_restarted_node_continues(start: Start, node: str) -> None:
    trial = start()
    trial.run(0.2)
    before = dict(trial.nodes)
    trial.restart(node, after=0.1)
    run = trial.run(0.5)
    assert not run.faults
    assert all(each.state_label == "active" for each in trial.nodes.values())
    assert sum(trial.nodes[name] is not before[name] for name in before) == 1
    assert run["/hazards/ctrl"].t[-1] == pytest.approx(0.7)
    assert run["/hazards/views"].at(0.7).data[2] > 0.1


def test_a_node_is_killed_or_restarted_while_it_starts(start: Start) -> None:
    schedule = Schedule(bring_up={"control": 0.3, "estimation": 0.2})
    trial = start(schedule=schedule)
    trial.run(0.1)
    assert trial.nodes[CONTROL].state_label == "inactive"
    trial.restart("control")
    trial.kill("estimation")
    run = trial.run(0.4)
    assert trial.nodes[CONTROL].state_label == "active"
    assert trial.nodes[ESTIMATION].state_label == "inactive"
    assert not run.faults


def test_a_restart_that_fails_is_a_fault(start: Start) -> None:
    trial = start()
    trial.run(0.1)
    trial._parameters[CONTROL] = {"fault": "configure"}
    trial.restart("control")
    run = trial.run(0.1)
    assert "not today" in run.faults[0]


def test_computing_time_and_latency_of_a_schedule(start: Start) -> None:
    schedule = Schedule(latency=0.001, compute={"estimation": 0.002})
    run = start(schedule=schedule).run(0.1)
    # The estimator ticks at 10 ms and publishes at 12 ms; the controller receives it at 13 ms.
    assert run["/hazards/est"].t[1] == pytest.approx(0.022)


def test_verbs_on_topics(start: Start) -> None:
    trial = start(seed=4)
    trial.run(0.1)
    trial.drop("/hazards/est", duration=0.1)
    lost = trial.run(0.1)["/hazards/views"].data
    assert len(set(lost[11:19, 2])) == 1
    trial.delay("/hazards/est", 0.05, duration=0.1)
    trial.noise("/hazards/joint_encoders", "y", 0.1)
    trial.publish("/hazards/ctrl", PositionSetpoint(u_mujoco=[7.0]))
    run = trial.run(0.1)
    assert 7.0 in [u for _, u in trial.nodes[ROBOT].applied]
    assert not run.faults
    with pytest.raises(LookupError, match="no node has the topic"):
        trial.drop("/hazards/estimate")


@pytest.mark.parametrize(
    ("act", "reported"),
    [
        (lambda trial: trial.run(-1.0), "the duration is -1.0"),
        (lambda trial: trial.run(math.nan), "the duration is nan"),
        (lambda trial: trial.push("body", (1.0, 0.0), 0.1), "three finite numbers"),
        (lambda trial: trial.push("body", (1.0, 0.0, math.nan), 0.1), "three finite numbers"),
        (lambda trial: trial.push("body", (1.0, 0.0, 0.0), 0), "the duration is 0"),
        (lambda trial: trial.push("world", (1.0, 0.0, 0.0), 0.1), "`world` cannot move"),
        (lambda trial: trial.scale_mass("body", math.nan), "factor nan"),
        (lambda trial: trial.drop(CTRL, 30), "from 0 to 1"),
        (lambda trial: trial.drop(CTRL, 0.5, duration=-0.1), "the duration is -0.1"),
        (lambda trial: trial.delay(CTRL, -0.1), "the delay is -0.1"),
        (lambda trial: trial.noise(CTRL, "u_mujoco", -0.1), "sigma is -0.1"),
        (lambda trial: trial.freeze("control", -1.0), "the duration is -1.0"),
        (lambda trial: trial.restart("control", after=-1.0), "the time until the restart is -1.0"),
        (lambda trial: trial.publish(CTRL, EstimatedState()), "not EstimatedState"),
        (
            lambda trial: trial.stub("/s", CTRL, lambda _: {}, JointEncoders),
            "obelisk_control_msgs/msg/PositionSetpoint, not JointEncoders",
        ),
        (lambda trial: trial.at(math.nan, lambda: None), "the time is nan"),
        (lambda trial: trial.at(-0.1, lambda: None), "the time is -0.1"),
        (lambda trial: (trial.run(0.1), trial.at(0.05, lambda: None)), "the time is 0.05"),
        (
            lambda trial: trial.call(f"{CONTROL}/get_parameters", SetParameters.Request()),
            "GetParameters_Request, not SetParameters_Request",
        ),
        (lambda trial: StackTrial(trial.stack, seed=-1), "the seed is -1"),
        (lambda _: Schedule(latency=-1.0), "latency is -1.0"),
        (lambda _: Schedule(compute={"control": math.inf}), "computing time of control is inf"),
    ],
)
def test_an_impossible_action_is_an_error_at_its_call(
    start: Start, act: Callable[[StackTrial], object], reported: str
) -> None:
    trial = start(seed=np.int64(3))
    with pytest.raises((ValueError, TypeError), match=reported):
        act(trial)
    assert not trial.run(0.1).faults


def test_actions_on_topics_affect_stubs_and_messages_from_outside(start: Start) -> None:
    trial = start(without=("control",), schedule=Schedule(latency=0.005))
    sent = PositionSetpoint(u_mujoco=[7.0])
    trial.stub("/stand_in", "/hazards/joint_encoders", lambda _: {CTRL: sent}, JointEncoders)
    applied = trial.nodes[ROBOT].applied
    trial.run(0.1)
    encoders = trial.result()["/hazards/joint_encoders"]
    assert applied[0] == (pytest.approx(encoders.t[0] + 0.01), 7.0)
    trial.drop(CTRL, duration=0.05)
    trial.publish(CTRL, PositionSetpoint(u_mujoco=[8.0]))
    trial.run(0.05)
    assert 8.0 not in [u for _, u in applied]
    times = np.array([t for t, _ in applied])
    assert np.diff(times).max() < 0.006
    assert times[-1] == pytest.approx(0.105, abs=0.006)
    trial.noise(CTRL, "u_mujoco", 0.1)
    assert {u for _, u in applied} == {7.0}
    trial.publish(CTRL, sent)
    trial.run(0.05)
    assert len({u for _, u in applied}) > 5
    with pytest.raises(LookupError, match="no node has the topic"):
        trial.publish("/hazards/control", sent)
    with pytest.raises(LookupError, match="needs a float or double"):
        trial.noise(CTRL, "header", 0.1)


def test_two_noises_on_a_field_are_independent(start: Start) -> None:
    trial = start(without=("control",))
    sent = PositionSetpoint(u_mujoco=[7.0])
    trial.stub("/stand_in", "/hazards/joint_encoders", lambda _: {CTRL: sent}, JointEncoders)
    for _ in range(2):
        trial.noise(CTRL, "u_mujoco", 0.1)
    trial.run(5.0)
    applied = np.array([u for _, u in trial.nodes[ROBOT].applied])
    assert applied.std() == pytest.approx(0.1 * np.sqrt(2), rel=0.15)


def test_a_fault_during_a_call_is_in_the_result(start: Start) -> None:
    trial = start(parameters={CONTROL: {"fault": "compute"}}, schedule=Schedule(latency=0.005))
    assert not trial.run(0.499).faults
    trial.call(f"{ESTIMATION}/get_parameters", GetParameters.Request())
    (fault,) = trial.result().faults
    assert "on purpose" in fault


def test_a_node_stays_frozen_until_the_last_freeze_ends(start: Start) -> None:
    trial = start()
    trial.freeze("control", 0.05)
    trial.freeze("control", 0.2)
    run = trial.run(0.3)
    assert 0.2 <= min(run[CTRL].t) < 0.25
    trial.freeze("control", math.inf)
    count = len(run[CTRL])
    assert len(trial.run(0.5)[CTRL]) == count


def test_a_killed_node_has_no_parameters(start: Start) -> None:
    trial = start()
    trial.kill("control")
    with pytest.raises(LockstepError, match="was killed"):
        trial.set_parameter("control", "fault", "none")
    trial.restart("control")
    trial.run(0.1)
    trial.set_parameter("control", "fault", "none")


def test_a_node_that_rejects_its_config_is_an_error_at_its_place(start: Start) -> None:
    with pytest.raises(LockstepError) as caught:
        start("control.params.fault=creation")
    assert str(caught.value).startswith(f"{CONFIG}:4:3: {CONTROL} ")
    assert caught.value.__cause__ is None


def test_a_parameter_that_a_node_rejects_is_an_error(start: Start) -> None:
    trial = start()
    trial.set_parameter("robot", "loop", "wait")
    with pytest.raises(LockstepError, match="rejects `loop`"):
        trial.set_parameter("robot", "loop", 3)


@pytest.mark.usefixtures("_lockstep_process")
def test_messages_of_the_workspace_that_are_not_compiled_are_an_error(tmp_path: Path) -> None:
    workspace = shutil.copytree(CONFIG.parent, tmp_path / "workspace")
    messages = workspace / "src" / "hazards_msgs"
    (messages / "msg").mkdir(parents=True)
    (messages / "msg" / "Hazard.msg").write_text("float64 x\n")
    (messages / "package.xml").write_text("<package><name>hazards_msgs</name></package>")
    with pytest.raises(CommandFailedError) as caught:
        load_stack(workspace / CONFIG.name, ["control.executable=needs_messages"])
    assert "hazards_msgs" in caught.value.message
    assert "obk build" in str(caught.value.help)


@pytest.mark.usefixtures("_lockstep_process")
def test_nothing_is_left_of_a_stack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    threads, arguments = threading.active_count(), list(sys.argv)
    stack = load_stack(CONFIG)
    assert list(tmp_path.iterdir())  # the parameters
    for seed in range(3):
        with StackTrial(stack, seed=seed) as trial:
            trial.run(0.05)
    stack.close()
    assert threading.active_count() == threads
    assert not list(tmp_path.iterdir())
    assert sys.argv == arguments
