"""The fields of a rule."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Rule", "Severity"]

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A rule: what it reports, why that is a problem, and how to fix it."""

    code: str
    severity: Severity
    title: str
    cause: str
    fix: str
