from demo_py.controler import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


def main() -> None:
    spin_obelisk(None, ArmController)
