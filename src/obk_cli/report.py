"""Format findings as text, as JSON, as GitHub annotations, and as SARIF.

The text has the message, the source line with the location underlined, related locations and help.
Info-level findings have only the message, unless `verbose` is set.
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import PurePath
from typing import TypedDict
from urllib.parse import quote

from obelisk_spec.suggestions import with_number
from obk_cli.diagnostics.diagnostic import SEVERITIES, Diagnostic, Related, Severity
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.rules import RULES
from obk_cli.diagnostics.source import Span
from obk_cli.terminal import escaped, visible

__all__ = [
    "FindingsReport",
    "report_github",
    "report_json",
    "report_sarif",
    "report_text",
    "summary",
]

_COLOURS: dict[str, str] = {"error": "31", "warning": "33", "info": "36", "help": "32", "dim": "2"}
_WIDEST = 160
"""Maximum number of characters shown of a line."""


def report_text(diagnostics: Iterable[Diagnostic], *, colour: bool, verbose: bool = False) -> str:
    """The findings one after another; those of several lines are separated by empty lines."""
    paint = _Paint(colour)
    groups = groupby(diagnostics, key=lambda d: d.severity == "info" and not verbose)
    blocks: list[str] = []
    for is_short, group in groups:
        if is_short:
            blocks.append("\n".join(_headline(diagnostic, paint) for diagnostic in group))
        else:
            blocks += ("\n".join(_block(diagnostic, paint)) for diagnostic in group)
    return "\n\n".join(blocks)


def summary(paths: Iterable[str], diagnostics: Iterable[Diagnostic], *, colour: bool) -> str:
    """One line: which files were checked and how many findings there are."""
    counts = Counter(diagnostic.severity for diagnostic in diagnostics)
    files = list(paths)
    where = files[0] if len(files) == 1 else f"{len(files)} files"
    paint = _Paint(colour)
    parts = [
        paint(severity, _counted(severity, counts[severity]))
        for severity in SEVERITIES
        if counts[severity]
    ]
    return f"{where}: {', '.join(parts) if parts else paint('help', 'no findings')}"


def _counted(severity: Severity, count: int) -> str:
    return f"{count} info" if severity == "info" else with_number(count, severity)


class _Paint:
    def __init__(self, colour: bool) -> None:
        self._colour = colour

    def __call__(self, role: str, text: str) -> str:
        return f"\x1b[{_COLOURS[role]}m{text}\x1b[0m" if self._colour else text


def _block(diagnostic: Diagnostic, paint: _Paint) -> Iterator[str]:
    yield _headline(diagnostic, paint)
    places = [
        (diagnostic.span, diagnostic.severity),
        *((r.span, "dim") for r in diagnostic.related),
    ]
    width = max(len(str(span.line)) for span, _ in places)
    yield from _excerpt(diagnostic.span, width, paint, diagnostic.severity)
    for related in diagnostic.related:
        yield f"  {escaped(f'{related.span}: {related.message}')}"
        yield from _excerpt(related.span, width, paint, "dim")
    if diagnostic.help:
        yield f"  {paint('help', 'help')}: {escaped(diagnostic.help)}"


def _headline(diagnostic: Diagnostic, paint: _Paint) -> str:
    kind = paint(diagnostic.severity, f"{diagnostic.severity}[{diagnostic.code}]")
    place, message = escaped(str(diagnostic.span)), escaped(diagnostic.message)
    return f"{place}: {kind}: {message}"


def _excerpt(span: Span, width: int, paint: _Paint, role: str) -> Iterator[str]:
    line = span.source.line(span.line).rstrip()
    if not line:
        return
    shown, column = _window(line, span)
    length = max(min(span.first_line_end - span.column, len(shown) + 1 - column), 1)
    # A tab is copied below itself, so that the mark lines up with the text.
    indent = "".join("\t" if char == "\t" else " " for char in shown[: column - 1])
    yield f"  {span.line:>{width}} | {visible(shown)}"
    if column <= len(shown) + 1:
        yield f"  {'':>{width}} | {indent}{paint(role, '^' * length)}"


def _window(line: str, span: Span) -> tuple[str, int]:
    """The part of a line that is shown, and the column in it at which the span starts."""
    end = min(span.first_line_end - 1, span.column - 1 + _WIDEST // 2)
    start = max(0, min(end + _WIDEST // 4, len(line)) - _WIDEST) if end > _WIDEST else 0
    before = "..." if start else ""
    after = "..." if start + _WIDEST < len(line) else ""
    shown = before + line[start : start + _WIDEST] + after
    return shown, span.column - start + len(before)


class _Place(TypedDict):
    path: str
    line: int
    column: int
    end_line: int
    end_column: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RelatedPlace:
    """Another place that concerns a finding."""

    message: str
    path: str
    line: int
    column: int
    end_line: int
    end_column: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedEdit:
    """A part of a file, and the text that replaces it."""

    path: str
    line: int
    column: int
    end_line: int
    end_column: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedFix:
    """A fix that `obk validate --fix` would make."""

    edits: tuple[ReportedEdit, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedFinding:
    """A finding and its place."""

    code: str
    severity: Severity
    message: str
    path: str
    """The file; as given on the command line, or as included from there."""
    line: int
    """The first line, counting from 1."""
    column: int
    """The first character, counting from 1."""
    end_line: int
    """The last line."""
    end_column: int
    """The character after the last one."""
    help: str | None
    """What would be right; null: nothing to add."""
    fix: ReportedFix | None
    """The edits of a safe fix; null: there is none."""
    related: tuple[RelatedPlace, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingsReport:
    """The findings of all checked configs."""

    files: tuple[str, ...]
    """The checked configs, as given on the command line."""
    diagnostics: tuple[ReportedFinding, ...]
    """The findings, in the order of the text output."""
    counts: dict[Severity, int]
    """Number of findings of each severity."""


def report_json(paths: Iterable[str], diagnostics: Iterable[Diagnostic]) -> str:
    """A `FindingsReport` as one JSON object."""
    findings = tuple(diagnostics)
    counts = Counter(finding.severity for finding in findings)
    report = FindingsReport(
        files=tuple(paths),
        diagnostics=tuple(map(_reported, findings)),
        counts={severity: counts[severity] for severity in SEVERITIES},
    )
    return json.dumps(asdict(report), indent=2, ensure_ascii=False)


def _reported(finding: Diagnostic) -> ReportedFinding:
    edits = tuple(ReportedEdit(**_place(edit.place), text=edit.text) for edit in finding.fix)
    return ReportedFinding(
        code=finding.code,
        severity=finding.severity,
        message=finding.message,
        **_place(finding.span),
        help=finding.help,
        fix=ReportedFix(edits=edits) if edits else None,
        related=tuple(
            RelatedPlace(message=related.message, **_place(related.span))
            for related in finding.related
        ),
    )


def _place(span: Span) -> _Place:
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
    return "\n".join(_annotation(diagnostic) for diagnostic in diagnostics)


def _annotation(diagnostic: Diagnostic) -> str:
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


_SARIF_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/os/schemas/sarif-schema-2.1.0.json"
_SARIF_LEVELS = {"error": "error", "warning": "warning", "info": "note"}


def report_sarif(diagnostics: Iterable[Diagnostic]) -> str:
    """One log with one run; relative paths become URIs relative to the working folder."""
    findings = tuple(diagnostics)
    codes = sorted({finding.code for finding in findings})
    driver = {"name": "obk", "rules": [_sarif_rule(code) for code in codes]}
    run = {
        "tool": {"driver": driver},
        # Columns count characters, as everywhere in obk.
        "columnKind": "unicodeCodePoints",
        "results": [_sarif_result(finding, codes.index(finding.code)) for finding in findings],
    }
    log = {"$schema": _SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2, ensure_ascii=False)


def _sarif_rule(code: str) -> dict[str, object]:
    rule = RULES[code]
    return {
        "id": code,
        "shortDescription": {"text": rule.title},
        "fullDescription": {"text": rule.cause},
        "help": {"text": rule.fix},
        "defaultConfiguration": {"level": _SARIF_LEVELS[rule.severity]},
    }


def _sarif_result(finding: Diagnostic, rule_index: int) -> dict[str, object]:
    text = f"{finding.message}\n{finding.help}" if finding.help else finding.message
    return {
        "ruleId": finding.code,
        "ruleIndex": rule_index,
        "level": _SARIF_LEVELS[finding.severity],
        "message": {"text": text},
        "locations": [{"physicalLocation": _sarif_place(finding.span)}],
        "relatedLocations": [_related(related) for related in finding.related],
        **({"fixes": [_sarif_fix(finding.fix)]} if finding.fix else {}),
    }


def _sarif_fix(edits: Iterable[Edit]) -> dict[str, object]:
    by_path: dict[str, list[Edit]] = {}
    for edit in edits:
        by_path.setdefault(edit.span.path, []).append(edit)
    return {
        "description": {"text": "`obk validate --fix` applies this fix"},
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
    return {"physicalLocation": _sarif_place(related.span), "message": {"text": related.message}}


def _sarif_place(span: Span) -> dict[str, object]:
    return {"artifactLocation": _artifact(span.path), "region": _region(span)}


def _artifact(name: str) -> dict[str, str]:
    path = PurePath(name)
    # Paths that are not text are encoded as bytes.
    relative = quote(str(path), errors="surrogateescape")
    return {"uri": path.as_uri() if path.is_absolute() else relative}


def _region(span: Span) -> dict[str, int]:
    return {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.end_line,
        "endColumn": span.end_column,
    }
