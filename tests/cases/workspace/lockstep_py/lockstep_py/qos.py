from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class QosController(Controller):
    """Publishes text that expires."""

    def __init__(self, node_name: str = "qos") -> None:
        super().__init__(node_name)
        short = QoSProfile(depth=1, lifespan=Duration(seconds=0.1))
        self.text = self.create_publisher(String, "~/text", short)


def main() -> None:
    spin_obelisk(None, QosController)
