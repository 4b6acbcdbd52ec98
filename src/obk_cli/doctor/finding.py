"""One finding of a check: severity, message, fix and measured facts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

__all__ = [
    "GIB",
    "MIB",
    "SEVERITIES",
    "Fact",
    "Finding",
    "Severity",
    "bytes_text",
    "error",
    "note",
    "ok",
    "warning",
]


Severity = Literal["ok", "note", "warning", "error"]
SEVERITIES: Final[tuple[Severity, ...]] = ("error", "warning", "note", "ok")
Fact = str | int | float | bool | None | tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A statement about the machine."""

    severity: Severity
    """`error`: stacks do not run; `warning`: a feature does not work; `note`: information."""
    message: str
    fix: str = ""
    """The fix: a command to copy or an instruction; empty if none is needed."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """Measured values."""


def ok(message: str, **facts: Fact) -> Finding:
    """Report that a check passed."""
    return Finding(severity="ok", message=message, facts=facts)


def note(message: str, fix: str = "", **facts: Fact) -> Finding:
    """Report information; nothing is broken."""
    return Finding(severity="note", message=message, fix=fix, facts=facts)


def warning(message: str, fix: str, **facts: Fact) -> Finding:
    """Report that a feature does not work."""
    return Finding(severity="warning", message=message, fix=fix, facts=facts)


def error(message: str, fix: str, **facts: Fact) -> Finding:
    """Report that stacks cannot run."""
    return Finding(severity="error", message=message, fix=fix, facts=facts)


MIB: Final = 1024**2
GIB: Final = 1024**3


def bytes_text(count: int) -> str:
    """Format a size, such as `64 MiB` or `1.5 GiB`."""
    if count < GIB:
        return f"{count / MIB:.0f} MiB"
    return f"{count / GIB:.1f} GiB"
