"""Helpers for the tests of findings."""

from collections.abc import Iterable

from obk_cli.doctor.finding import Finding


def the_one(findings: Iterable[Finding], severity: str) -> Finding:
    """The only finding of a severity; errors and warnings always have a help text."""
    found = [finding for finding in findings if finding.severity == severity]
    assert len(found) == 1, found
    if severity in ("error", "warning"):
        assert found[0].fix
    return found[0]


def severities(findings: Iterable[Finding]) -> list[str]:
    """The severities, in order."""
    return [finding.severity for finding in findings]
