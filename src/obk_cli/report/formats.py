"""Findings as JSON, as annotations of GitHub, and as SARIF."""

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import PurePath
from urllib.parse import quote

from obk_cli.diagnostics.diagnostic import Diagnostic, Related
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.rules import rule_of
from obk_cli.diagnostics.source import Span

__all__ = ["report_github", "report_json", "report_sarif"]


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
        **_json_place(finding.span),
        "help": finding.help,
        "fix": {"edits": [_edit(edit) for edit in finding.fix]} if finding.fix else None,
        "related": [{"message": r.message, **_json_place(r.span)} for r in finding.related],
    }


def _edit(edit: Edit) -> dict[str, object]:
    """The stretch that gives way, and the text that takes its place."""
    return {**_json_place(edit.place), "text": edit.text}


def _json_place(span: Span) -> dict[str, object]:
    return {
        "path": span.path,
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }


_GITHUB_LEVELS = {"error": "error", "warning": "warning", "info": "notice"}


def report_github(diagnostics: Iterable[Diagnostic]) -> str:
    """One line for each finding."""
    return "\n".join(_line(diagnostic) for diagnostic in diagnostics)


def _line(diagnostic: Diagnostic) -> str:
    span = diagnostic.span
    places = {
        "file": span.path,
        "line": span.line,
        "endLine": span.end_line,
        "col": span.column,
        "endColumn": span.end_column,
        "title": diagnostic.code,
    }
    fields = ",".join(f"{name}={_property(str(value))}" for name, value in places.items())
    notes = [f"{related.span}: {related.message}" for related in diagnostic.related]
    helps = [f"help: {diagnostic.help}"] if diagnostic.help else []
    text = _data("\n".join((diagnostic.message, *notes, *helps)))
    return f"::{_GITHUB_LEVELS[diagnostic.severity]} {fields}::{text}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/os/schemas/sarif-schema-2.1.0.json"
_LEVELS = {"error": "error", "warning": "warning", "info": "note"}


def report_sarif(diagnostics: Iterable[Diagnostic]) -> str:
    """One log with one run; paths are URIs, relative ones relative to the working folder."""
    findings = tuple(diagnostics)
    codes = sorted({finding.code for finding in findings})
    driver = {"name": "obk", "rules": [_rule(code) for code in codes]}
    run = {
        "tool": {"driver": driver},
        # Columns count characters, as everywhere in the tool.
        "columnKind": "unicodeCodePoints",
        "results": [_result(finding, codes.index(finding.code)) for finding in findings],
    }
    log = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2, ensure_ascii=False)


def _rule(code: str) -> dict[str, object]:
    rule = rule_of(code)
    return {
        "id": code,
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.cause},
        "help": {"text": rule.fix},
        "defaultConfiguration": {"level": _LEVELS[rule.severity]},
    }


def _result(finding: Diagnostic, rule_index: int) -> dict[str, object]:
    text = f"{finding.message}\n{finding.help}" if finding.help else finding.message
    return {
        "ruleId": finding.code,
        "ruleIndex": rule_index,
        "level": _LEVELS[finding.severity],
        "message": {"text": text},
        "locations": [{"physicalLocation": _place(finding.span)}],
        "relatedLocations": [_related(related) for related in finding.related],
        **({"fixes": [_fix(finding.fix)]} if finding.fix else {}),
    }


def _fix(edits: Iterable[Edit]) -> dict[str, object]:
    by_path: dict[str, list[Edit]] = {}
    for edit in edits:
        by_path.setdefault(edit.span.path, []).append(edit)
    return {
        "description": {"text": "the fix that `obk validate --fix` applies"},
        "artifactChanges": [
            {
                "artifactLocation": _artifact(path),
                "replacements": [_replacement(edit) for edit in of_file],
            }
            for path, of_file in by_path.items()
        ],
    }


def _replacement(edit: Edit) -> dict[str, object]:
    region = _region(edit.place)
    if not edit.text:
        return {"deletedRegion": region}
    return {"deletedRegion": region, "insertedContent": {"text": edit.text}}


def _related(related: Related) -> dict[str, object]:
    return {"physicalLocation": _place(related.span), "message": {"text": related.message}}


def _place(span: Span) -> dict[str, object]:
    return {"artifactLocation": _artifact(span.path), "region": _region(span)}


def _artifact(name: str) -> dict[str, str]:
    path = PurePath(name)
    # Its bytes, where they are no text.
    relative = quote(str(path), errors="surrogateescape")
    return {"uri": path.as_uri() if path.is_absolute() else relative}


def _region(span: Span) -> dict[str, int]:
    return {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.end_line,
        "endColumn": span.end_column,
    }
