"""A node whose class is only known at run time, so that its code cannot be checked."""

from demo.kinds import node_type
from obelisk_py.core.utils.ros import spin_obelisk


def main() -> None:
    spin_obelisk(None, node_type(__name__))
