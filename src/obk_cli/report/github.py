"""Findings as workflow commands, which GitHub shows beside the lines of a pull request.

Source: GitHub documentation, "Workflow commands for GitHub Actions".
"""

from collections.abc import Iterable

from obk_cli.diagnostics.diagnostic import Diagnostic

__all__ = ["report_github"]

_LEVELS = {"error": "error", "warning": "warning", "info": "notice"}


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
    return f"::{_LEVELS[diagnostic.severity]} {fields}::{text}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
