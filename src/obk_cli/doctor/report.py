"""Findings of `obk doctor` as text and as JSON."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Final

from obelisk_spec.suggestions import with_number
from obk_cli.doctor.finding import SEVERITIES, Finding, Severity
from obk_cli.doctor.runner import Answer

__all__ = ["doctor_json", "doctor_text"]

_COLOURS: Final[dict[str, str]] = {"ok": "32", "note": "36", "warning": "33", "error": "31"}
_WIDTH: Final = max(map(len, SEVERITIES))


def doctor_text(answers: Sequence[Answer], *, colour: bool) -> str:
    """A line for each finding with its fix below, and a summary."""
    width = max((len(answer.check) for answer in answers), default=0)
    lines: list[str] = []
    for answer in answers:
        for place, finding in enumerate(answer.findings):
            name = answer.check if place == 0 else ""
            lines += _lines(f"{name:<{width}}", finding, colour)
    return "\n".join((*lines, "", _summary(answers, colour)))


def doctor_json(answers: Sequence[Answer]) -> str:
    """All findings with their measured values."""
    findings = [
        {"check": answer.check, **asdict(finding)}
        for answer in answers
        for finding in answer.findings
    ]
    seconds = {answer.check: round(answer.seconds, 3) for answer in answers}
    counts = _counts(answers)
    report = {
        "findings": findings,
        "counts": {s: counts[s] for s in SEVERITIES},
        "seconds": seconds,
    }
    return json.dumps(report, indent=1)


def _lines(name: str, finding: Finding, colour: bool) -> Iterator[str]:
    word = _coloured(finding.severity, f"{finding.severity:<{_WIDTH}}", colour)
    indent = " " * (len(name) + _WIDTH + 4)
    first, *rest = finding.message.splitlines()
    yield f"{name}  {word}  {first}"
    yield from (f"{indent}{line}" for line in rest)
    if finding.cure:
        yield f"{indent}fix: {finding.cure}"


def _summary(answers: Sequence[Answer], colour: bool) -> str:
    counts = _counts(answers)
    parts = [
        _coloured(severity, with_number(counts[severity], severity), colour)
        for severity in SEVERITIES
        if severity != "ok" and counts[severity]
    ]
    checks = with_number(len(answers), "check")
    return f"{checks}: {', '.join(parts) if parts else _coloured('ok', 'no problems', colour)}"


def _counts(answers: Sequence[Answer]) -> Counter[Severity]:
    return Counter(finding.severity for answer in answers for finding in answer.findings)


def _coloured(severity: Severity, text: str, colour: bool) -> str:
    return f"\x1b[{_COLOURS[severity]}m{text}\x1b[0m" if colour else text
