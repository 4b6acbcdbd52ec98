from obelisk_control_msgs.msg import PositionSetpoint
from std_srvs.srv import Trigger

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class WaitingController(Controller):
    """Waits in a callback for the response of a service."""

    def __init__(self, node_name: str = "waiting") -> None:
        super().__init__(node_name)
        self.reset = self.create_client(Trigger, "~/reset")

    def compute_control(self) -> PositionSetpoint:
        self.reset.call(Trigger.Request())
        return super().compute_control()


def main() -> None:
    spin_obelisk(None, WaitingController)
