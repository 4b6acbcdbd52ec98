"""All control messages of obelisk_control_msgs on a simulated robot: valid, invalid, late, old."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from obelisk_control_msgs.msg import ExecutionFSM, PDFeedForward, PositionSetpoint, VelocityCommand
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from obelisk_py.core import command_watchdog
from obelisk_py.core.sim.mujoco import ObeliskMujocoRobot
from obelisk_spec.components import format_setting

from .stack import DEADLINE_S, eventually, parameters, request, spinning

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

ARM = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body><joint name="hip" damping="1"/><geom size="0.1" pos="0.3 0 0"/>
      <body pos="0.6 0 0"><joint name="knee" damping="1"/><geom size="0.1" pos="0.3 0 0"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="hip"/><motor joint="knee"/></actuator>
</mujoco>
"""
NAN, INFINITE = float("nan"), float("inf")
GAINS = {"pos_target": [0.0, 0.0], "kp": [0.0, 0.0]}
"""Gains for zero torque, so that the actuators get the feed-forward."""


def torques(*values: float) -> PDFeedForward:
    """A message with gains and these torques."""
    return PDFeedForward(feed_forward=values, **GAINS)


def written(*values: float) -> PDFeedForward:
    """A message without gains, whose `u_mujoco` is used."""
    return PDFeedForward(u_mujoco=values)


def setpoint(*values: float) -> PositionSetpoint:
    return PositionSetpoint(u_mujoco=values)


def older_setpoint(*values: float) -> PositionSetpoint:
    """A message that is filled by the older name of the field."""
    message = PositionSetpoint()
    message.u = values  # type: ignore[attr-defined]
    return message


VALID = pytest.mark.parametrize("make", [setpoint, older_setpoint, written, torques])


@contextmanager
def simulator(
    folder: Path, message: type[Any], by: str = "config", **settings: object
) -> Iterator[Any]:
    """An unconfigured simulator whose control type comes from the config or from the code."""
    (folder / "arm.xml").write_text(ARM)
    setting: dict[str, object] = {"topic": "/ctrl", **settings}
    if by == "config":
        setting["msg_type"] = message.__name__
    wired = {
        "mujoco_setting": format_setting({"model_xml_path": str(folder / "arm.xml")}),
        "sub_ctrl_setting": format_setting(setting),
    }

    def make() -> ObeliskMujocoRobot:
        return ObeliskMujocoRobot("sim", message if by == "code" else None, **parameters(**wired))

    with spinning(make) as node:
        reported: list[str] = []
        logger = node.get_logger()
        for level in ("error", "warning"):
            setattr(logger, level, reported.append)
        node.reported = reported  # type: ignore[attr-defined]
        yield node


def active(node: Any, message: type[Any]) -> Any:
    """Activate it; return the publisher of its commands."""
    assert request(node, "configure"), node.last_fault
    assert request(node, "activate")
    publisher = node.create_publisher(message, "/ctrl", 10)
    eventually(publisher.get_subscription_count, "the subscription of the simulator")
    return publisher


def controls(node: Any) -> list[float]:
    return list(node._simulation.data.ctrl)


def output(node: Any, part: str) -> bool:
    return any(part in text for text in node.reported)


def stamp(node: Any, ago_s: float) -> Header:
    """A header with a stamp some time ago."""
    seconds, nanoseconds = divmod(node.get_clock().now().nanoseconds - int(ago_s * 1e9), 10**9)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds))


@VALID
@pytest.mark.parametrize("by", ["config", "code"])
def test_a_valid_command_reaches_the_actuators(tmp_path: Path, make: Any, by: str) -> None:
    message = type(make(0.0, 0.0))
    with simulator(tmp_path, message, by) as node:
        active(node, message).publish(make(0.5, -0.25))
        eventually(lambda: controls(node) == [0.5, -0.25], "the control")
        assert node.reported == []


@VALID
@pytest.mark.parametrize(
    ("values", "refusal"),
    [
        ((1.0,), "has the length 1, expected 2 "),
        ((1.0, 2.0, 3.0), "has the length 3, expected 2 "),
        ((NAN, 0.0), "[0]` is nan"),
        ((0.0, INFINITE), "[1]` is inf"),
        ((0.0, -INFINITE), "[1]` is -inf"),
        ((1e11, 0.0), "[0]` is 1e+11"),
    ],
)
def test_an_invalid_command_is_rejected_and_reported(
    tmp_path: Path, make: Any, values: tuple[float, ...], refusal: str
) -> None:
    message = type(make(0.0, 0.0))
    with simulator(tmp_path, message) as node:
        publisher = active(node, message)
        publisher.publish(make(0.5, -0.25))
        publisher.publish(make(*values))
        eventually(lambda: output(node, refusal), "the refusal")
        assert output(node, "control rejected: `")
        eventually(lambda: controls(node) == [0.5, -0.25], "the control before it")
        publisher.publish(make(0.1, 0.2))
        eventually(lambda: controls(node) == [0.1, 0.2], "the control behind it")
        assert node.state_label == "active"


@VALID
def test_a_late_command_is_applied_and_reported(tmp_path: Path, make: Any) -> None:
    message = type(make(0.0, 0.0))
    with simulator(tmp_path, message) as node:
        publisher = active(node, message)
        late = make(0.5, -0.25)
        late.header = stamp(node, 60.0)
        publisher.publish(late)
        eventually(lambda: controls(node) == [0.5, -0.25], "the control")
        eventually(
            lambda: output(node, "late control applied: its stamp is more than 1 s old (1x)"),
            "that it is late",
        )


@VALID
def test_a_command_out_of_order_is_kept_out_and_reported(tmp_path: Path, make: Any) -> None:
    message = type(make(0.0, 0.0))
    with simulator(tmp_path, message) as node:
        publisher = active(node, message)
        newer, older = make(0.5, -0.25), make(9.0, 9.0)
        newer.header, older.header = stamp(node, 30.0), stamp(node, 31.0)
        publisher.publish(newer)
        publisher.publish(older)
        eventually(
            lambda: output(node, "its stamp is older than that of the applied control"), "reported"
        )
        eventually(lambda: controls(node) == [0.5, -0.25], "the newer control")


@pytest.mark.parametrize("message", [VelocityCommand, ExecutionFSM])
@pytest.mark.parametrize("by", ["config", "code"])
def test_a_message_without_a_control_is_rejected_at_configure(
    tmp_path: Path, message: type[Any], by: str
) -> None:
    with simulator(tmp_path, message, by) as node:
        assert not request(node, "configure")
        assert (
            f"the control message {message.__name__} has neither a field `u_mujoco` nor `u`"
            in node.last_fault.text
        )


@VALID
def test_old_commands_become_zeros_although_the_executor_is_busy(tmp_path: Path, make: Any) -> None:
    message = type(make(0.0, 0.0))
    with simulator(tmp_path, message, max_age_sec=0.3) as node:
        is_busy, is_free = threading.Event(), threading.Event()

        def be_busy(_request: Any, response: Any) -> Any:
            is_busy.set()
            is_free.wait(DEADLINE_S)
            return response

        node.create_service(Trigger, "~/be_busy", be_busy)
        client = node.create_client(Trigger, "~/be_busy")
        publisher = active(node, message)
        eventually(client.service_is_ready, "the service")
        publisher.publish(make(0.5, -0.25))
        eventually(lambda: node._inbox.newest is not None, "the command")
        client.call_async(Trigger.Request())
        assert is_busy.wait(DEADLINE_S)
        eventually(lambda: controls(node) == [0.0, 0.0] and node._command_age.is_stale, "the zeros")
        assert not is_free.is_set()
        is_free.set()
        set_to_zero = "s: every control value is set to zero (`stale_action: zero`)"
        eventually(lambda: output(node, set_to_zero), "what learns of the silence")
        publisher.publish(make(0.1, 0.2))
        eventually(lambda: output(node, "commands resumed after "), "the next command")


def test_the_simulator_brakes_a_robot_whose_commands_stop(tmp_path: Path) -> None:
    with simulator(tmp_path, PositionSetpoint, max_age_sec=0.3, stale_action="damp") as node:
        publisher = active(node, PositionSetpoint)
        publisher.publish(setpoint(5.0, 0.0))
        eventually(lambda: output(node, "the robot brakes (`stale_action: damp`)"), "the brake")
        data = node._simulation.data
        eventually(lambda: abs(data.qvel).max() < 0.01, "the robot at rest")
        assert controls(node) != [5.0, 0.0]


@pytest.mark.parametrize("wrong", [setpoint(1.0), setpoint(NAN, 0.0)])
def test_rejected_commands_do_not_count(tmp_path: Path, wrong: PositionSetpoint) -> None:
    with simulator(tmp_path, PositionSetpoint, max_age_sec=100.0) as node:
        active(node, PositionSetpoint)
        node._take_control(setpoint(1.0, 2.0))
        deadline_s = node._command_age.deadline_s
        assert deadline_s is not None
        node._take_control(wrong)
        assert node._command_age.deadline_s == deadline_s
        node._take_control(setpoint(1.0, 2.0))
        assert node._command_age.deadline_s > deadline_s


def test_no_thread_but_the_stepping_one_watches_the_commands_of_a_simulator(tmp_path: Path) -> None:
    with simulator(tmp_path, PositionSetpoint, max_age_sec=100.0) as node:
        active(node, PositionSetpoint)
        assert "command watchdog" not in {thread.name for thread in threading.enumerate()}


def test_a_simulator_that_gets_only_rejected_commands_reports_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command_watchdog, "LASTING_S", 0.0)
    with simulator(tmp_path, PositionSetpoint) as node:
        active(node, PositionSetpoint)
        node._take_control(setpoint(NAN, 0.0))
        assert output(
            node, "no valid message has been received for 0.0 s, so the robot has no commands"
        )


def test_no_command_grows_old_while_the_simulation_is_paused(tmp_path: Path) -> None:
    with simulator(tmp_path, PositionSetpoint, max_age_sec=100.0) as node:
        pause = node.create_client(SetBool, "~/pause")
        active(node, PositionSetpoint)
        node._take_control(setpoint(1.0, 2.0))
        eventually(pause.service_is_ready, "the service")
        paused = pause.call_async(SetBool.Request(data=True))
        eventually(paused.done, "the pause")
        paused_s = time.monotonic()
        eventually(lambda: node._command_age.deadline_s > paused_s + 100.1, "a later deadline")
