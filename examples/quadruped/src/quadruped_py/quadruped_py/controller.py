"""The controller node: computes joint positions for the drives from an estimate."""

from dataclasses import replace

import numpy as np
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk
from quadruped_py.gait import Gait, Trunk, desired_angles
from quadruped_py.odometry import rotation_matrix

__all__ = ["QuadrupedController", "main"]


class QuadrupedController(ObeliskController):
    """Makes the robot stand up, sway and trot; the drives hold the commanded joint positions."""

    sway_m = Parameter(Gait().sway_m, ge=0.0, le=0.1, unit="m", description="sway of the trunk")
    lift_m = Parameter(Gait().lift_m, ge=0.0, le=0.1, unit="m", description="height of the steps")
    step_s = Parameter(
        Gait().step_s, ge=0.1, unit="s", description="duration of a step", live=False
    )

    x_hat: EstimatedState | None = None
    """The latest estimate."""
    started: tuple[float, np.ndarray] | None = None
    """The start time of standing up [s], and the joint angles then [rad], shape (4, 3)."""

    def __init__(self, node_name: str = "quadruped_controller") -> None:
        """Create the node; its topics and rates come from the config."""
        super().__init__(node_name, ctrl_msg_type=PositionSetpoint, est_msg_type=EstimatedState)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters."""
        self.gait = Gait(sway_m=self.sway_m, lift_m=self.lift_m, step_s=self.step_s)
        return super().on_configure(state)

    def on_parameters(self, changed: frozenset[str]) -> None:
        """Continue with the new gait."""
        if not changed.isdisjoint(("sway_m", "lift_m")):
            self.gait = replace(self.gait, sway_m=self.sway_m, lift_m=self.lift_m)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Restart the motion: stand up from the current pose."""
        self.x_hat = self.started = None
        return super().on_activate(state)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        """Store the latest state estimate."""
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint | None:
        """Publish the desired joint positions, starting with the first estimate."""
        if self.x_hat is None:
            return None
        if self.started is None:
            self.started = (self.t, np.reshape(self.x_hat.q_joints, (4, 3)))
        start_s, start = self.started
        base = np.array(self.x_hat.q_base)
        trunk = Trunk(place=base[:2], rotation=rotation_matrix(base[3:]))
        angles = desired_angles(self.t - start_s, start, trunk, self.gait).ravel().tolist()
        msg = PositionSetpoint(q_des=angles, u_mujoco=angles)
        msg.header.stamp = self.x_hat.header.stamp
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, QuadrupedController)
