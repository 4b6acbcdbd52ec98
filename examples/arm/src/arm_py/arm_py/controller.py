"""The controller node: computes targets, gains and torques for the drives from an estimate."""

from pathlib import Path

import numpy as np
from obelisk_control_msgs.msg import PDFeedForward
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from arm_py.law import Gravity, Motion
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["ArmController", "main"]

JOINTS = 6


class ArmController(ObeliskController):
    """Moves the arm from pose to pose; `params_path` is the model for gravity compensation."""

    kp = Parameter([100.0] * JOINTS, ge=0.0, unit="N m/rad", description="gain of each drive")
    kd = Parameter([5.0] * JOINTS, ge=0.0, unit="N m s/rad", description="damping of each drive")
    poses = Parameter(
        [0.0] * JOINTS, unit="rad", description="the angles of all poses in a row", live=False
    )
    move_s = Parameter(2.5, ge=0.1, unit="s", description="time between poses", live=False)
    rest_s = Parameter(1.0, ge=0.0, unit="s", description="time at each pose", live=False)

    x_hat: EstimatedState | None = None
    """The latest estimate."""
    started: tuple[float, Motion] | None = None
    """The start time of the motion [s], and the motion."""

    def __init__(self, node_name: str = "arm_controller") -> None:
        """Create the node; its topics and rates come from the config."""
        super().__init__(node_name, ctrl_msg_type=PDFeedForward, est_msg_type=EstimatedState)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the model."""
        self.gravity = Gravity(Path(self.params_path))
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Restart the motion from the current pose of the arm."""
        self.x_hat = self.started = None
        return super().on_activate(state)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        """Store the latest state estimate."""
        self.x_hat = x_hat_msg

    def compute_control(self) -> PDFeedForward | None:
        """Publish commands for the drives, starting with the first estimate."""
        if self.x_hat is None:
            return None
        q = np.array(self.x_hat.q_joints)
        start_s, motion = self.started = self.started or (self.t, self._motion_from(q))
        angles, speeds = motion.at(self.t - start_s)
        msg = PDFeedForward(
            joint_names=self.x_hat.joint_names,
            pos_target=angles.tolist(),
            vel_target=speeds.tolist(),
            feed_forward=self.gravity.torques(q).tolist(),
            kp=self.kp,
            kd=self.kd,
        )
        msg.header.stamp = self.x_hat.header.stamp
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg

    def _motion_from(self, angles: np.ndarray) -> Motion:
        poses = np.reshape(self.poses, (-1, JOINTS))
        return Motion(start=angles, poses=poses, move_s=self.move_s, rest_s=self.rest_s)


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, ArmController)
