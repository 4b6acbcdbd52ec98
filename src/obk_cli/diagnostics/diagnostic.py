"""Findings in the user's text as values, which are collected and never raised."""

from collections.abc import Iterable
from dataclasses import dataclass

from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.rules import RULES, Severity
from obk_cli.diagnostics.source import Span

__all__ = [
    "SEVERITIES",
    "Diagnostic",
    "Related",
    "Severity",
    "counted",
    "found",
    "in_order",
    "worst",
]

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""Worst first."""
_MOST_OF_ONE_RULE = 1_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Related:
    """Another location that a finding refers to."""

    message: str
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One finding."""

    code: str
    severity: Severity
    message: str
    span: Span
    help: str | None = None
    related: tuple[Related, ...] = ()
    fix: tuple[Edit, ...] = ()
    """The edits that fix it; only if the fix is safe."""

    def __str__(self) -> str:
        return f"{self.span}: {self.severity}[{self.code}]: {self.message}"


def found(
    code: str,
    message: str,
    span: Span,
    *,
    help: str | None = None,
    related: Iterable[Related] = (),
    severity: Severity | None = None,
    fix: Iterable[Edit] = (),
) -> Diagnostic:
    """Create a finding, with the severity of its rule unless another is given."""
    return Diagnostic(
        code=code,
        severity=severity or RULES[code].severity,
        message=message,
        span=span,
        help=help,
        related=tuple(related),
        fix=tuple(fix),
    )


def in_order(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Findings in reading order, without duplicates."""
    unique = dict.fromkeys(diagnostics)
    return tuple(
        sorted(unique, key=lambda d: (d.span.path, d.span.line, d.span.column, d.code, d.message))
    )


def counted(
    diagnostics: Iterable[Diagnostic], *, most: int = _MOST_OF_ONE_RULE
) -> tuple[Diagnostic, ...]:
    """The first findings of every rule; one line counts the rest of each rule."""
    by_code: dict[str, list[Diagnostic]] = {}
    kept: list[Diagnostic] = []
    for diagnostic in diagnostics:
        same = by_code.setdefault(diagnostic.code, [])
        same.append(diagnostic)
        if len(same) <= most:
            kept.append(diagnostic)
    for code, same in by_code.items():
        rest = same[most:]
        severity = worst(rest)
        if severity:
            message = f"and {len(rest):,} more findings of this rule, the first of them here"
            kept.append(found(code, message, rest[0].span, severity=severity))
    return tuple(kept)


def worst(diagnostics: Iterable[Diagnostic]) -> Severity | None:
    """The worst severity among the findings; None if there are no findings."""
    present = {diagnostic.severity for diagnostic in diagnostics}
    return next((severity for severity in SEVERITIES if severity in present), None)
