"""Findings as JSON, for programs: every place with its end, and the edits of certain cures."""

import json
from collections import Counter
from collections.abc import Iterable

from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.source import Span

__all__ = ["report_json"]


def report_json(paths: Iterable[str], diagnostics: Iterable[Diagnostic]) -> str:
    """One JSON object: `files`, `diagnostics`, `counts`."""
    findings = tuple(diagnostics)
    counts = Counter(finding.severity for finding in findings)
    report = {
        "files": list(paths),
        "diagnostics": [_finding(finding) for finding in findings],
        "counts": {severity: counts[severity] for severity in ("error", "warning", "info")},
    }
    return json.dumps(report, indent=2, ensure_ascii=False)


def _finding(finding: Diagnostic) -> dict[str, object]:
    return {
        "code": finding.code,
        "severity": finding.severity,
        "message": finding.message,
        **_place(finding.span),
        "help": finding.help,
        "fix": {"edits": [_edit(edit) for edit in finding.fix]} if finding.fix else None,
        "related": [{"message": r.message, **_place(r.span)} for r in finding.related],
    }


def _edit(edit: Edit) -> dict[str, object]:
    """The stretch that gives way, and the text that takes its place."""
    return {**_place(edit.place), "text": edit.text}


def _place(span: Span) -> dict[str, object]:
    return {
        "path": span.path,
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }
