"""Programs that cannot run in lockstep."""

import time

import rclpy

from obelisk_py.core.utils.ros import spin_obelisk

from .controller import Controller


def with_helper(args=None):
    """Create a plain node next to the one that spins."""
    if not rclpy.ok():
        rclpy.init()
    rclpy.create_node("helper")
    spin_obelisk(args, Controller)


def needs_messages(args=None):
    """Import messages of a package that a test adds to the workspace."""
    from hazards_msgs.msg import Hazard  # noqa: F401


def without_spin(args=None):
    """Return without a node."""


def waits(args=None):
    """Wait for something before the node is created."""
    time.sleep(3.0)
    spin_obelisk(args, Controller)
