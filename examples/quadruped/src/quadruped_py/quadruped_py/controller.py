"""The controller's node: a state estimate in, joint positions for the drives out."""

from dataclasses import replace

import numpy as np
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.parameter import Parameter
from obelisk_py.core.utils.ros import spin_obelisk
from quadruped_py.gait import Gait, Trunk, wanted_angles
from quadruped_py.odometry import rotation_matrix

__all__ = ["QuadrupedController", "main"]


class QuadrupedController(ObeliskController):
    """Stands up, sways and trots; the drives hold the joints to the positions that it sends."""

    sway_m = Parameter(
        Gait().sway_m, ge=0.0, le=0.1, unit="m", description="how far the trunk sways"
    )
    lift_m = Parameter(
        Gait().lift_m, ge=0.0, le=0.1, unit="m", description="how high the feet are lifted"
    )
    step_s = Parameter(Gait().step_s, ge=0.1, unit="s", description="time of a step", live=False)

    x_hat: EstimatedState | None = None
    """The newest estimate."""
    began: tuple[float, np.ndarray] | None = None
    """When it began to stand up [s], and with which joint angles [rad], shape (4, 3)."""

    def __init__(self, node_name: str = "quadruped_controller") -> None:
        """Make the node; its topics and rates come from the config."""
        super().__init__(node_name, ctrl_msg_type=PositionSetpoint, est_msg_type=EstimatedState)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the parameters."""
        self.gait = Gait(sway_m=self.sway_m, lift_m=self.lift_m, step_s=self.step_s)
        return super().on_configure(state)

    def on_parameters(self, changed: frozenset[str]) -> None:
        """Go on with the new gait."""
        if not changed.isdisjoint(("sway_m", "lift_m")):
            self.gait = replace(self.gait, sway_m=self.sway_m, lift_m=self.lift_m)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the motion again: it stands up from wherever it is."""
        self.x_hat = self.began = None
        return super().on_activate(state)

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None:
        """Keep the newest state estimate."""
        self.x_hat = x_hat_msg

    def compute_control(self) -> PositionSetpoint | None:
        """Publish where the joints are to be; nothing before the first estimate."""
        if self.x_hat is None:
            return None
        if self.began is None:
            self.began = (self.t, np.reshape(self.x_hat.q_joints, (4, 3)))
        began_s, start = self.began
        base = np.array(self.x_hat.q_base)
        trunk = Trunk(place=base[:2], rotation=rotation_matrix(base[3:]))
        angles = wanted_angles(self.t - began_s, start, trunk, self.gait).ravel().tolist()
        msg = PositionSetpoint(q_des=angles, u_mujoco=angles)
        msg.header.stamp = self.x_hat.header.stamp
        self.obk_publishers["pub_ctrl"].publish(msg)
        return msg


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped."""
    spin_obelisk(args, QuadrupedController)
