"""The terms of a policy's observation: their names, and how many numbers each has."""

from collections.abc import Sequence
from typing import Final

__all__ = ["COMMAND", "PREVIOUS_ACTION", "TERMS", "observation_size"]

COMMAND: Final = "command"
PREVIOUS_ACTION: Final = "previous_action"
_JOINT_TERMS: Final = ("joint_positions", "joint_velocities")
_BASE_TERMS: Final = ("linear_velocity", "angular_velocity", "gravity")
TERMS: Final = (*_JOINT_TERMS, *_BASE_TERMS, PREVIOUS_ACTION, COMMAND)
"""What the parameter `observation` of `OnnxPolicy` may contain."""
_DIMENSIONS: Final = 3


def observation_size(terms: Sequence[str], *, joints: int, actions: int) -> int:
    """How many numbers an observation has.

    Args:
        terms: of `TERMS`.
        joints: number of observed joints.
        actions: number of the network's outputs.
    """
    sizes = {
        **dict.fromkeys(_JOINT_TERMS, joints),
        **dict.fromkeys((*_BASE_TERMS, COMMAND), _DIMENSIONS),
        PREVIOUS_ACTION: actions,
    }
    return sum(sizes[term] for term in terms)
