"""The robot udp_motor_robot, and `main` to run it as a process."""

import math
import time
from collections import Counter

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_py.core.exceptions import ObeliskHardwareError
from obelisk_py.core.robot import ObeliskRobot
from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_sensor_msgs.msg import JointEncoders
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from udp_motor_robot.link import DriveLink
from udp_motor_robot.protocol import PORT, Fault, Mode

__all__ = ["UdpMotorRobot", "main"]

ANSWER_S = 1.0
"""Timeout for the first answer of the drive [s]."""


class UdpMotorRobot(ObeliskRobot):
    """Sends positions to the drive, and publishes its encoder values as JointEncoders.

    ROS parameters: `drive_host`, `drive_port`, and `drive_timeout_sec`, the longest time without a
    state while the node is active [s].
    """

    def __init__(self, node_name: str = "udp_motor_robot") -> None:
        """Create the node; its topics, rates and queue depths come from the config."""
        super().__init__(node_name, ctrl_msg_type=PositionSetpoint)
        self.declare_parameter("drive_host", "127.0.0.1")
        self.declare_parameter("drive_port", PORT)
        # Accept integers such as 1 too.
        self.declare_parameter("drive_timeout_sec", 0.5, ParameterDescriptor(dynamic_typing=True))
        self.link: DriveLink | None = None
        self.address = ""
        self.timeout_s = 0.0
        self.is_commanded = False
        self.rejected: Counter[str] = Counter()
        self.register_obk_publisher(
            "pub_sensor_setting",
            key="pub_sensor",
            msg_type=JointEncoders,
        )
        self.register_obk_timer(
            "timer_sensor_setting",
            self.publish_sensor,
            key="timer_sensor",
        )
        self.register_obk_timer(
            "timer_report_setting",
            self.report,
            key="timer_report",
            default={"timer_period_sec": 1.0},
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the connection to the drive.

        Raises:
            ObeliskHardwareError: the drive cannot be reached, or does not answer.
        """
        result = super().on_configure(state)
        host = str(self.get_parameter("drive_host").value)
        port = int(self.get_parameter("drive_port").value)
        self.address = f"{host}:{port}"
        self.timeout_s = float(self.get_parameter("drive_timeout_sec").value)
        try:
            self.link = DriveLink(host, port)
        except (OSError, OverflowError) as error:
            fault = f"cannot reach the drive at {self.address}: {error}"
            raise ObeliskHardwareError(fault) from error
        # Closed in `cleanup`, in `shutdown` and after any error; closing stops the motor.
        self.opened.callback(self.link.close)
        self._ask_drive(self.link)
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Check that the drive still answers.

        Raises:
            ObeliskHardwareError: the drive does not answer.
        """
        assert self.link is not None
        self.is_commanded = False
        self.rejected.clear()
        self._ask_drive(self.link)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the motor."""
        assert self.link is not None
        self.link.stop()
        return super().on_deactivate(state)

    def apply_control(self, control_msg: PositionSetpoint) -> bool:
        """Send the control message to the drive; return False if it is rejected."""
        assert self.link is not None
        command = control_msg.u_mujoco
        if len(command) != 1:
            self.rejected[f"`u_mujoco` has length {len(command)}, expected 1"] += 1
        elif not math.isfinite(command[0]):
            self.rejected[f"`u_mujoco[0]` is {command[0]:g}"] += 1
        else:
            self.is_commanded = True
            self.link.send(Mode.POSITION, command[0])
            return True
        return False

    def apply_damping(self) -> None:
        """Stop the motor after `max_age_sec` without a command; friction brakes the joint."""
        assert self.link is not None
        self.is_commanded = False
        self.link.stop()

    def publish_sensor(self) -> JointEncoders | None:
        """Publish the latest state of the drive, unless there is no new one.

        Raises:
            ObeliskHardwareError: no state was received for too long, or the drive has a fault.
        """
        assert self.link is not None
        state = self.link.newest()
        if state is None:
            silent_s = time.monotonic() - self.link.received_at_s
            if silent_s > self.timeout_s:
                raise ObeliskHardwareError(
                    f"the drive at {self.address} has sent no new state for {silent_s:.2f} s"
                )
            return None
        if state.faults & Fault.OVERSPEED:
            raise ObeliskHardwareError(
                f"the drive at {self.address} has switched its motor off: overspeed"
            )
        if state.faults & Fault.WATCHDOG and self.is_commanded:
            self.link.faults["motor off without a command"] += 1
        msg = JointEncoders()
        msg.header.stamp = self.get_clock().now().to_msg()
        msg.y = [state.position]
        self.obk_publishers["pub_sensor"].publish(msg)
        return msg

    def report(self) -> None:
        """Log the rejected commands and the connection faults since the last report."""
        assert self.link is not None
        if self.rejected:
            reasons = (f"{reason} ({count}x)" for reason, count in self.rejected.items())
            self.get_logger().warning(f"control rejected: {'; '.join(reasons)}")
            self.rejected.clear()
        if self.link.faults:
            counts = (f"{what} ({count}x)" for what, count in self.link.faults.items())
            self.get_logger().warning(f"connection to the drive: {', '.join(counts)}")
            self.link.faults.clear()

    def _ask_drive(self, link: DriveLink) -> None:
        if link.ask(ANSWER_S) is None:
            why = f" ({link.error})" if link.error else ""
            raise ObeliskHardwareError(
                f"the drive at {self.address} did not answer within {ANSWER_S:g} s{why}: "
                "is it on, and are `drive_host` and `drive_port` right?"
            )


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, UdpMotorRobot)


if __name__ == "__main__":
    main()
