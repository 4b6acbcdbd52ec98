"""A controller that computes the key of a timer."""

import os

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class Controller(ObeliskController):
    def __init__(self) -> None:
        super().__init__("controller", PositionSetpoint, EstimatedState)
        self.register_obk_timer("timer_tick_setting", self.tick, key=os.environ["TICK"])

    def update_x_hat(self, x_hat_msg: EstimatedState) -> None: ...

    def compute_control(self) -> None: ...

    def tick(self) -> None: ...


def main() -> None:
    spin_obelisk(None, Controller)
