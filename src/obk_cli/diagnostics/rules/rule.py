"""What a rule is."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Rule", "Severity"]

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule: what it finds, why that hurts, what to do about it."""

    code: str
    severity: Severity
    title: str
    cause: str
    fix: str
