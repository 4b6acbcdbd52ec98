"""The sections of a config that hold nodes, in the order in which their nodes come up."""

from typing import Final

__all__ = ["TIERS"]

TIERS: Final = ("robot", "sensing", "estimation", "control", "viz", "joystick")
"""Sections in bring-up order: data flows downstream, so nobody activates into a void."""
