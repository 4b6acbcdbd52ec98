"""What a check says of one thing: how it is, what was measured, and what to do about it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

__all__ = ["SEVERITIES", "Fact", "Finding", "Severity", "error", "note", "ok", "warning"]

Severity = Literal["ok", "note", "warning", "error"]
SEVERITIES: Final[tuple[Severity, ...]] = ("error", "warning", "note", "ok")
Fact = str | int | float | bool | None | tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One sentence about the machine."""

    severity: Severity
    """`error`: stacks do not run; `warning`: what one may need does not; `note`: to know."""
    message: str
    cure: str = ""
    """A command to copy, or what else to do; empty where nothing is to be done."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """What was measured."""


def ok(message: str, **facts: Fact) -> Finding:
    """All is well."""
    return Finding(severity="ok", message=message, facts=facts)


def note(message: str, cure: str = "", **facts: Fact) -> Finding:
    """Nothing is broken; good to know."""
    return Finding(severity="note", message=message, cure=cure, facts=facts)


def warning(message: str, cure: str, **facts: Fact) -> Finding:
    """Something that one may need does not work."""
    return Finding(severity="warning", message=message, cure=cure, facts=facts)


def error(message: str, cure: str, **facts: Fact) -> Finding:
    """Stacks do not run like this."""
    return Finding(severity="error", message=message, cure=cure, facts=facts)
