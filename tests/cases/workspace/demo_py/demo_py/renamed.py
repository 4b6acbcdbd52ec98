from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class DampedArmController(ArmController):
    pass


def main() -> None:
    spin_obelisk(None, DampenedArmController)
