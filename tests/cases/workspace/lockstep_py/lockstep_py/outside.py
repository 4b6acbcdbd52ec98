import socket

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class Link:
    """A helper class that the node's code uses."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


class OutsideController(Controller):
    """Sends to another machine."""

    def __init__(self, node_name: str = "outside") -> None:
        super().__init__(node_name)
        self.link = Link()


def main() -> None:
    spin_obelisk(None, OutsideController)
