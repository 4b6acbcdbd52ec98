"""What goes wrong in a run, as values: crashes that wait to be dealt with, reasons to come down."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Crash", "Failure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Crash:
    """Something that the rule `on_crash` is for and that is not dealt with yet."""

    unit: str
    kind: Literal["ended", "hung", "fault"]
    text: str
    node: str
    """Whose fault it is; of a process that ended or hangs, one of its nodes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why the stack comes down."""

    text: str
    node: str | None = None
