import time

from obelisk_control_msgs.msg import PositionSetpoint

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class ClockController(Controller):
    """Measures its own processor time."""

    def compute_control(self) -> PositionSetpoint:
        start = time.process_time()
        msg = super().compute_control()
        self.spent = time.process_time() - start
        return msg


def main() -> None:
    spin_obelisk(None, ClockController)
