"""UdpMotorRobot with a simulated drive in the same process, over the loopback interface."""

import math
import socket
import threading
import time
from collections.abc import Iterator

import pytest
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_py.core.exceptions import ObeliskHardwareError
from obelisk_sensor_msgs.msg import JointEncoders
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from udp_motor_robot.protocol import Command, Fault, Mode, State
from udp_motor_robot.udp_motor_robot import UdpMotorRobot

SUCCESS = TransitionCallbackReturn.SUCCESS
SETTINGS = {
    "sub_ctrl_setting": "{topic: /test/ctrl}",
    "pub_sensor_setting": "{topic: /test/sensor}",
    "timer_sensor_setting": "{timer_period_sec: 0.01}",
}
DEADLINE_S = 10.0


class Answering:
    """A drive that answers each command with a state, and stores the commands."""

    def __init__(self) -> None:
        """Listen on a free port."""
        self.commands: list[Command] = []
        self.faults = Fault.NONE
        self.is_silent = False
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.bind(("127.0.0.1", 0))
        self.port: int = self._line.getsockname()[1]
        self._came = threading.Condition()
        self._thread = threading.Thread(target=self._answer)
        self._thread.start()

    def wait_for(self, mode: Mode, value: float) -> None:
        """Wait until a command has been received."""
        with self._came:
            assert self._came.wait_for(lambda: self._has(mode, value), DEADLINE_S), self.commands

    def close(self) -> None:
        """Stop the thread and close the socket."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(b"", ("127.0.0.1", self.port))
        self._thread.join()
        self._line.close()

    def _has(self, mode: Mode, value: float) -> bool:
        return any(c.mode is mode and c.value == value for c in self.commands)

    def _answer(self) -> None:
        while True:
            data, sender = self._line.recvfrom(100)
            command = Command.unpack(data)
            if command is None:
                return
            with self._came:
                self.commands.append(command)
                self._came.notify()
            state = State(
                sequence=len(self.commands),
                time_s=1.0,
                position=0.25,
                velocity=0.0,
                faults=self.faults,
            )
            if not self.is_silent:
                self._line.sendto(state.pack(), sender)


@pytest.fixture
def drive() -> Iterator[Answering]:
    """A drive that answers."""
    drive = Answering()
    yield drive
    drive.close()


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch, drive: Answering) -> Iterator[UdpMotorRobot]:
    """The robot with the settings above, not configured and not spinning."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    arguments = ["--ros-args", "-p", f"drive_port:={drive.port}"]
    for name, value in SETTINGS.items():
        arguments += ["-p", f"{name}:='{value}'"]
    rclpy.init(args=arguments)
    node = UdpMotorRobot()
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def active(robot: UdpMotorRobot) -> UdpMotorRobot:
    """The robot in the active state."""
    assert robot.trigger_configure() == SUCCESS
    assert robot.trigger_activate() == SUCCESS
    return robot


@pytest.fixture
def warnings(robot: UdpMotorRobot, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The warnings that the robot logs."""
    warnings: list[str] = []
    monkeypatch.setattr(robot.get_logger(), "warning", warnings.append)
    return warnings


def test_a_command_reaches_the_drive_and_zero_torque_at_deactivate(
    active: UdpMotorRobot, drive: Answering
) -> None:
    """Positions are sent unchanged; leaving the active state stops the motor."""
    active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    drive.wait_for(Mode.POSITION, 0.5)
    drive.commands.clear()
    assert active.trigger_deactivate() == SUCCESS
    drive.wait_for(Mode.TORQUE, 0.0)


@pytest.mark.parametrize("way", ["cleanup", "shutdown", "error"])
def test_every_way_out_stops_the_motor(active: UdpMotorRobot, drive: Answering, way: str) -> None:
    """The robot sends zero torque before it closes the socket, in all transitions."""
    if way == "cleanup":
        assert active.trigger_deactivate() == SUCCESS
    active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    drive.wait_for(Mode.POSITION, 0.5)
    drive.commands.clear()
    ways = {"cleanup": active.trigger_cleanup, "shutdown": active.trigger_shutdown}
    ways.get(way, lambda: active.fail("a fault"))()
    drive.wait_for(Mode.TORQUE, 0.0)


def test_without_commands_the_motor_is_stopped(active: UdpMotorRobot, drive: Answering) -> None:
    """`stale_action: damp` stops the motor."""
    assert active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    drive.wait_for(Mode.POSITION, 0.5)
    drive.commands.clear()
    active.apply_damping()
    drive.wait_for(Mode.TORQUE, 0.0)


def test_invalid_commands_are_rejected_and_reported_once(
    active: UdpMotorRobot, drive: Answering, warnings: list[str]
) -> None:
    """Commands with a wrong length or NaN are not sent to the drive."""
    for command in ([], [0.1, 0.2], [0.3, 0.4], [math.nan]):
        assert not active.apply_control(PositionSetpoint(u_mujoco=command))
    active.report()
    active.report()
    assert warnings == [
        "control rejected: `u_mujoco` has length 0, expected 1 (1x); "
        "`u_mujoco` has length 2, expected 1 (2x); `u_mujoco[0]` is nan (1x)"
    ]
    assert all(command.mode is not Mode.POSITION for command in drive.commands)


def test_a_state_is_published_once(
    active: UdpMotorRobot, drive: Answering, monkeypatch: pytest.MonkeyPatch
) -> None:
    """publish_sensor publishes the message that it returns; without a new state, neither."""
    sent: list[JointEncoders] = []
    monkeypatch.setattr(active.obk_publishers["pub_sensor"], "publish", sent.append)
    active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    drive.wait_for(Mode.POSITION, 0.5)
    msg = publish_until(active, DEADLINE_S)
    assert msg is not None
    assert sent == [msg]
    assert active.publish_sensor() is None
    assert list(msg.y) == [0.25]


def test_without_a_drive_configure_fails_with_a_message(
    robot: UdpMotorRobot, drive: Answering
) -> None:
    """If no drive answers, the node stays unconfigured and reports what to check."""
    drive.is_silent = True
    assert robot.trigger_configure() != SUCCESS
    assert robot.state_label == "unconfigured"
    assert str(robot.last_fault) == (
        f"on_configure: the drive at 127.0.0.1:{drive.port} did not answer within 1 s: "
        "is it on, and are `drive_host` and `drive_port` right?"
    )
    drive.is_silent = False
    assert robot.trigger_configure() == SUCCESS


def test_an_unusable_address_is_reported(robot: UdpMotorRobot) -> None:
    """The report has no traceback."""
    robot.set_parameters([Parameter("drive_port", value=70_000)])
    assert robot.trigger_configure() != SUCCESS
    assert "cannot reach the drive at 127.0.0.1:70000" in str(robot.last_fault)
    assert "Traceback" not in str(robot.last_fault)


def test_a_drive_that_became_silent_while_the_robot_was_inactive_fails_activate(
    robot: UdpMotorRobot, drive: Answering
) -> None:
    """States that were received earlier do not count."""
    assert robot.trigger_configure() == SUCCESS
    drive.is_silent = True
    assert robot.trigger_activate() != SUCCESS
    assert "did not answer within 1 s" in str(robot.last_fault)
    assert robot.state_label == "unconfigured"


def test_a_silent_drive_is_a_fault(active: UdpMotorRobot, drive: Answering) -> None:
    """The robot does not repeat old values as if they were measured; it fails."""
    drive.is_silent = True
    active.timeout_s = 0.05
    with pytest.raises(ObeliskHardwareError, match=r"has sent no new state for \d+\.\d\d s"):
        publish_until(active, DEADLINE_S)


def test_a_drive_that_has_switched_itself_off_is_a_fault(
    active: UdpMotorRobot, drive: Answering
) -> None:
    """A persistent fault of the drive requires an operator."""
    active.timeout_s = DEADLINE_S
    drive.faults = Fault.OVERSPEED
    active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    with pytest.raises(ObeliskHardwareError, match="switched its motor off: overspeed"):
        publish_until(active, DEADLINE_S)


def test_states_with_the_motor_off_are_reported(
    active: UdpMotorRobot, drive: Answering, warnings: list[str]
) -> None:
    """The drive's watchdog is reported after the first command; it recovers by itself."""
    active.timeout_s = DEADLINE_S
    drive.faults = Fault.WATCHDOG
    active.apply_control(PositionSetpoint(u_mujoco=[0.5]))
    assert publish_until(active, DEADLINE_S) is not None
    active.report()
    assert warnings == ["connection to the drive: motor off without a command (1x)"]


def publish_until(robot: UdpMotorRobot, deadline_s: float) -> JointEncoders | None:
    """Publish until there is a new state."""
    end_s = time.monotonic() + deadline_s
    while time.monotonic() < end_s:
        msg = robot.publish_sensor()
        if msg is not None:
            return msg
    return None
