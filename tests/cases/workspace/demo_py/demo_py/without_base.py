from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class HastyController(ArmController):
    def __init__(self, node_name: str = "hasty_controller") -> None:
        self.gain = 2.0


def main() -> None:
    spin_obelisk(None, HastyController)
