"""A controller that publishes values of time, random numbers and its components."""

import random
from time import monotonic

import numpy as np
from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from std_msgs.msg import Float64MultiArray

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.utils.ros import spin_obelisk

UNSEEDED = np.random.default_rng()
PLAIN = random.Random()


class Controller(ObeliskController):
    """Follows a sine; its `fault` parameter makes a callback or `configure` fail."""

    legacy = np.random.RandomState()

    def __init__(self, node_name: str = "controller") -> None:
        super().__init__(node_name, PositionSetpoint, EstimatedState)
        self.declare_parameter("fault", "none")
        self.views = self.create_publisher(Float64MultiArray, "/hazards/views", 10)
        self.estimate = 0.0
        made = self.get_parameter("fault").value
        if made == "creation":
            raise ObeliskConfigError("`fault` is creation, expected none")
        assert made == "none"

    def on_configure(self, state):
        if self.get_parameter("fault").value == "configure":
            raise RuntimeError("not today")
        return super().on_configure(state)

    def update_x_hat(self, x_hat_msg):
        self.estimate = x_hat_msg.q_joints[0]

    def compute_control(self):
        if self.get_parameter("fault").value == "compute" and self.t >= 0.5:
            raise ValueError("on purpose")
        chance = np.random.default_rng().random()
        kept = [UNSEEDED.random(), PLAIN.random(), self.legacy.random_sample()]
        views = [self.t, monotonic(), self.estimate, chance, *kept]
        self.views.publish(Float64MultiArray(data=views))
        message = PositionSetpoint(u_mujoco=[float(np.sin(self.t))])
        self.obk_publishers["pub_ctrl"].publish(message)
        return message


def main(args=None):
    """Run the node."""
    spin_obelisk(args, Controller)
