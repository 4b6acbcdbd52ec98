from demo_py.controller import ArmControler
from obelisk_py.core.utils.ros import spin_obelisk


def main() -> None:
    spin_obelisk(None, ArmControler)
