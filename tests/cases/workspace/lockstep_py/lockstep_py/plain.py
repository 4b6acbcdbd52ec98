from rclpy.node import Node

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class Helper(Node):
    """A node without a life cycle."""


class PlainController(Controller):
    """Creates a second node."""

    def __init__(self, node_name: str = "plain") -> None:
        super().__init__(node_name)
        self.helper = Helper("helper")


def main() -> None:
    spin_obelisk(None, PlainController)
