from obelisk_control_msgs.msg import PositionSetpoint
from std_msgs.msg import String

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class SetController(Controller):
    """Publishes the items of a set."""

    def __init__(self, node_name: str = "sets") -> None:
        super().__init__(node_name)
        self.text = self.create_publisher(String, "~/text", 1)
        self.joints = {"hip", "knee"}

    def compute_control(self) -> PositionSetpoint:
        for name in self.joints:
            self.text.publish(String(data=name))
        return super().compute_control()


def main() -> None:
    spin_obelisk(None, SetController)
