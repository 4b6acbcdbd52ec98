"""Requests to a running stack, each with the function that takes its answer.

They come from the state node (any ROS 2 client) and from the control socket.
"""

from collections.abc import Callable
from dataclasses import dataclass

from obk_cli.runs.protocol import ChangeAnswer, StackStatus

__all__ = ["ChangeAsked", "StatusAsked"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeAsked:
    """Somebody wants nodes taken through a transition; answered once, at the latest at the end."""

    transition: str
    reply: Callable[[ChangeAnswer], None]
    """May be called from any thread; must return at once."""
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: float | None = None
    """For each node's transition [s]; None: the launch's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusAsked:
    """Somebody wants to know how the stack is; answered at once, also during a transition."""

    reply: Callable[[StackStatus], None]
