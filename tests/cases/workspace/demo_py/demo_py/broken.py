from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class Broken(ArmController)
    """A colon is missing."""


def main() -> None:
    spin_obelisk(None, Broken)
