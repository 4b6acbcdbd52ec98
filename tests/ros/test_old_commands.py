"""The behavior of a real robot whose commands stop."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from obelisk_control_msgs.msg import PDFeedForward
from std_srvs.srv import Trigger

from obelisk_py.core import command_watchdog, robot
from obelisk_py.core.robot import ObeliskRobot

from .stack import DEADLINE_S, eventually, parameters, request, spinning

pytestmark = pytest.mark.ros

COMMAND = PDFeedForward(
    pos_target=[1.0, 2.0],
    feed_forward=[3.0, 4.0],
    joint_names=["hip", "knee"],
    kp=[5.0, 6.0],
    kd=[7.0, 8.0],
)


class Arm(ObeliskRobot):
    """A robot that records its commands."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("arm", PDFeedForward, **kwargs)
        self.applied: list[PDFeedForward] = []
        self.is_busy = threading.Event()
        self.is_free = threading.Event()
        self.create_service(Trigger, "~/be_busy", self._be_busy)

    def apply_control(self, control_msg: PDFeedForward) -> bool | None:
        if len(control_msg.kp) != 2:
            return False
        self.applied.append(control_msg)
        return None

    def _be_busy(self, _request: Any, response: Any) -> Any:
        self.is_busy.set()
        self.is_free.wait(DEADLINE_S)
        return response


class BrakingArm(Arm):
    """A robot that can brake."""

    dampings = 0

    def apply_damping(self) -> None:
        self.dampings += 1


@contextmanager
def arm(kind: type[Arm] = Arm, **settings: object) -> Iterator[Any]:
    """An active robot with a maximum command age of half a second."""
    written = {"topic": "/ctrl", "max_age_sec": 0.5, **settings}
    text = ", ".join(f"{key}: {value}" for key, value in written.items())
    with spinning(lambda: kind(**parameters(sub_ctrl_setting=f"{{{text}}}"))) as node:
        node.reported, node.errors = [], []
        node.get_logger().error = lambda text: (
            node.errors.append(text),
            node.reported.append(text),
        )
        node.get_logger().warning = node.reported.append
        yield node


def active(node: Any) -> Any:
    """Activate the robot; return the publisher of its commands."""
    publisher = node.create_publisher(PDFeedForward, "/ctrl", 10)
    assert request(node, "configure")
    assert request(node, "activate")
    eventually(publisher.get_subscription_count, "the subscription of the robot")
    return publisher


def test_zeros_are_applied_once_and_the_next_command_is_executed() -> None:
    with arm() as node:
        publisher = active(node)
        publisher.publish(COMMAND)
        eventually(lambda: len(node.applied) == 2, "the command and the zeros")
        zeros = node.applied[1]
        assert [*zeros.kp, *zeros.kd, *zeros.pos_target, *zeros.feed_forward] == [0.0] * 8
        assert zeros.joint_names == ["hip", "knee"]
        assert zeros.header.stamp.sec > 0
        eventually(lambda: node.reported, "what learns of the silence")
        publisher.publish(COMMAND)
        eventually(lambda: len(node.applied) >= 3, "the next command")
        assert node.applied[2] == COMMAND
        eventually(lambda: len(node.reported) > 1, "what learns of the command")
        old, again, *_ = node.reported
        assert node.errors[0] == old
        assert old.startswith("no command for ")
        assert old.endswith(
            "s, more than `max_age_sec` of 0.5 s: every control value is set to zero "
            "(`stale_action: zero`)"
        )
        assert again.startswith("commands resumed after ")


def test_a_robot_that_gets_no_command_says_so_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot, "LONGEST_IDLE_S", 0.1)
    with arm() as node:
        publisher = active(node)
        eventually(lambda: node.reported, "the warning")
        (warning,) = node.reported
        assert warning.startswith("no command has arrived on /ctrl")
        assert warning.endswith("its publishers: /arm")
        publisher.publish(COMMAND)
        eventually(lambda: node.applied, "the command")
        publisher.publish(COMMAND)
        eventually(lambda: len(node.applied) > 1, "the next command")
        assert "no command has arrived" not in "".join(node.reported[1:])


def test_neither_a_missing_command_nor_that_of_the_last_run_is_old() -> None:
    with arm(max_age_sec=0.01) as node:
        publisher = active(node)
        publisher.publish(COMMAND)
        eventually(lambda: len(node.applied) == 2, "the command and the zeros")
        assert request(node, "deactivate")
        assert request(node, "activate")
        assert node._command_age.deadline_s is None
        assert not node._command_age.is_stale
        assert request(node, "deactivate")
        assert len(node.applied) == 2
        assert "command watchdog" not in {thread.name for thread in threading.enumerate()}


def test_a_busy_executor_does_not_prevent_a_safe_stop() -> None:
    with arm() as node:
        publisher = active(node)
        publisher.publish(COMMAND)
        eventually(lambda: node.applied, "the command")
        client = node.create_client(Trigger, "~/be_busy")
        eventually(client.service_is_ready, "the service")
        client.call_async(Trigger.Request())
        assert node.is_busy.wait(DEADLINE_S)
        eventually(lambda: len(node.applied) == 2, "the zeros")
        assert not node.is_free.is_set()
        node.is_free.set()


def test_a_call_that_does_not_return_blocks_the_action_and_is_reported() -> None:
    with arm(max_age_sec=0.01) as node:
        active(node)
        with node._applying:  # because apply_control is called with it
            node._newest_control = COMMAND
            node._command_age.accept(time.monotonic())
            node._watchdog.wake()
            eventually(lambda: node.errors, "what learns of the silence")
            assert node.errors[0].endswith(
                "; the action is delayed because apply_control has not returned"
            )
            assert node.applied == []
        eventually(lambda: node.applied, "the zeros")


@pytest.mark.parametrize(
    ("refused", "reported"),
    [
        (
            PDFeedForward(kp=[1.0]),
            ["control rejected: apply_control returned False (1x); 1 in total"],
        ),
        (
            PDFeedForward(kp=[1.0, float("nan")]),
            ["control rejected: `kp[1]` is nan (1x); 1 in total"],
        ),
    ],
)
def test_a_rejected_command_does_not_count(refused: PDFeedForward, reported: list[str]) -> None:
    with arm(max_age_sec=100.0) as node:
        publisher = active(node)
        publisher.publish(COMMAND)
        eventually(lambda: node._command_age.deadline_s, "the command")
        before = node._command_age.deadline_s
        node._take_control(refused)
        assert node._command_age.deadline_s == before
        assert node.applied == [COMMAND]
        assert node.reported == reported


def test_a_controller_that_ends_before_its_robot_is_no_error() -> None:
    with arm() as node:
        publisher = active(node)
        publisher.publish(COMMAND)
        eventually(lambda: node.applied, "the command")
        node.destroy_publisher(publisher)
        eventually(lambda: node.reported, "what learns of the silence")
        assert node.reported[0].endswith("(`stale_action: zero`); no node publishes /ctrl any more")
        assert node.errors == []


def test_a_robot_deactivated_soon_after_the_last_command_reports_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command_watchdog, "SILENCE_GRACE_S", 1000.0)
    with arm(max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: len(node.applied) == 2, "the command and the zeros")
        assert request(node, "deactivate")
        assert node.reported == []


def test_a_robot_that_receives_only_rejected_commands_logs_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command_watchdog, "LASTING_S", 0.0)
    with arm() as node:
        active(node)
        node._take_control(PDFeedForward(kp=[1.0, float("nan")]))
        (error,) = node.errors
        assert "`kp[1]` is nan" in error
        assert node._command_age.deadline_s is None


def test_rejections_that_were_a_warning_become_an_error_in_rclpys_own_log(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with spinning(lambda: Arm(**parameters(sub_ctrl_setting="{topic: /ctrl}"))) as node:
        for is_lasting in (False, True, False):
            node._log_rejection(command_watchdog.RejectionReport("control rejected", is_lasting))
    reported = [
        line.split()[0] for line in capfd.readouterr().err.splitlines() if "rejected" in line
    ]
    assert reported == ["[WARN]", "[ERROR]", "[WARN]"]


def test_hold_only_reports() -> None:
    with arm(stale_action="hold", max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.reported, "what is reported")
        assert "`stale_action: hold`" in node.reported[0]
        assert node.applied == [COMMAND]


def test_a_robot_that_can_brake_brakes_once() -> None:
    with arm(BrakingArm, stale_action="damp", max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.dampings, "the damping")
        assert request(node, "deactivate")
        assert node.dampings == 1
        assert node.applied == [COMMAND]


def test_a_robot_that_cannot_brake_is_not_configured_to() -> None:
    with arm(stale_action="damp") as node:
        assert not request(node, "configure")
        assert node.last_fault.text == (
            "Arm does not implement apply_damping, but the config sets `stale_action: damp`"
        )


def test_an_exception_in_the_action_takes_the_robot_to_error_processing() -> None:
    class Broken(Arm):
        def apply_control(self, control_msg: PDFeedForward) -> None:
            if not any(control_msg.kp):
                raise OSError("the bus is gone")

    with arm(Broken, max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert "the bus is gone" in str(node.last_fault)


def test_an_action_that_ends_its_thread_takes_the_robot_to_error_processing() -> None:
    class Exiting(Arm):
        def apply_damping(self) -> None:
            raise SystemExit(3)

    with arm(Exiting, stale_action="damp", max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.state_label == "unconfigured", "error processing")
        assert "SystemExit: 3" in str(node.last_fault)


def test_an_action_that_does_not_return_is_reported() -> None:
    class Hanging(Arm):
        def apply_damping(self) -> None:
            self.is_busy.set()
            assert self.is_free.wait(DEADLINE_S)

    with arm(Hanging, stale_action="damp", max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.errors, "the error")
        assert node.is_busy.is_set()
        assert node.errors[0].endswith("; the action has not returned")
        node.is_free.set()


def test_there_is_no_action_while_the_robot_deactivates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_watchdog, "SILENCE_GRACE_S", 0.0)

    class Slow(BrakingArm):
        def on_deactivate(self, state: Any) -> Any:
            self._command_age.accept(time.monotonic())  # its watchdog is due during this call
            self._watchdog.wake()
            eventually(lambda: self._command_age.deadline_s is None, "the watchdog")
            return super().on_deactivate(state)

    with arm(Slow, stale_action="damp", max_age_sec=0.01) as node:
        active(node)
        assert request(node, "deactivate")
        assert node.dampings == 0
        assert node.reported == []


def test_a_rejected_command_of_zeros_is_an_error() -> None:
    class Limited(Arm):
        def apply_control(self, control_msg: PDFeedForward) -> bool | None:
            return super().apply_control(control_msg) if any(control_msg.kp) else False

    with arm(Limited, max_age_sec=0.01) as node:
        active(node).publish(COMMAND)
        eventually(lambda: node.errors, "the error")
        assert "zeros" in node.errors[0]
        assert node.applied == [COMMAND]
