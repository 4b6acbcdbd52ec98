"""Verdicts of a rehearsal as text, as a table for a terminal and as JSON."""

import json
from collections.abc import Iterator, Sequence
from io import StringIO
from typing import Any, Final

from obelisk_spec.suggestions import with_number
from obk_cli.faultinject.verdict import Verdict
from obk_cli.report.launch import short_name

__all__ = ["HEAD", "rehearsal_json", "rehearsal_table", "rehearsal_text"]

HEAD: Final = ("node", "fault", "expected", "seen", "noticed [s]", "settled [s]", "")
"""Titles of the columns; the last one holds the verdict."""
_NUMBERS: Final = (4, 5)
_RIGHT: Final = "ok"
_WRONG: Final = "FAILED"


def rehearsal_text(verdicts: Sequence[Verdict]) -> str:
    """A table in plain columns, what is not as expected below it, and a summary."""
    cells = [HEAD, *map(_cells, verdicts)]
    widths = [max(len(verdict[column]) for verdict in cells) for column in range(len(HEAD))]
    lines = ["  ".join(_aligned(verdict, widths)).rstrip() for verdict in cells]
    return "\n".join((*lines, *_below(verdicts)))


def rehearsal_table(verdicts: Sequence[Verdict], width: int) -> str:
    """The same, drawn and coloured for a terminal of this width."""
    from rich import box  # rich is slow to import
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, title in enumerate(HEAD):
        table.add_column(Text(title), justify="right" if column in _NUMBERS else "left")
    for verdict in verdicts:
        *cells, mark = _cells(verdict)
        style = "green" if verdict.is_right else "bold red"
        table.add_row(*map(Text, cells), Text(mark, style))
    console = Console(file=StringIO(), width=width, force_terminal=True, color_system="standard")
    with console.capture() as capture:
        console.print(table)
    drawn = (line for line in capture.get().splitlines() if line.strip())
    return "\n".join((*drawn, *_below(verdicts)))


def rehearsal_json(verdicts: Sequence[Verdict]) -> str:
    """The verdicts as a document for programs."""
    is_right = all(verdict.is_right for verdict in verdicts)
    return json.dumps({"ok": is_right, "rows": [_data(verdict) for verdict in verdicts]}, indent=1)


def _cells(verdict: Verdict) -> tuple[str, ...]:
    return (
        short_name(verdict.case.unit.name),
        verdict.case.fault,
        verdict.case.expectation.summary,
        verdict.seen,
        _seconds(verdict.noticed_s, 3),
        _seconds(verdict.settled_s, 1),
        _RIGHT if verdict.is_right else _WRONG,
    )


def _seconds(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    for column, (cell, width) in enumerate(zip(cells, widths, strict=True)):
        yield cell.rjust(width) if column in _NUMBERS else cell.ljust(width)


def _below(verdicts: Sequence[Verdict]) -> Iterator[str]:
    wrong = [verdict for verdict in verdicts if not verdict.is_right]
    for verdict in wrong:
        yield ""
        yield f"{verdict.case.fault} {short_name(verdict.case.unit.name)}:"
        yield from (f"  {fault}" for fault in verdict.faults)
        if verdict.run is not None:
            yield f"  see {verdict.run / 'launch.log'}"
    yield ""
    expectations = with_number(len(verdicts), "expectation")
    yield f"{len(verdicts) - len(wrong)} of {expectations} met" if wrong else f"{expectations} met"


def _data(verdict: Verdict) -> dict[str, Any]:
    unit, expectation = verdict.case.unit, verdict.case.expectation
    return {
        "process": unit.name,
        "nodes": list(unit.node_names),
        "fault": verdict.case.fault,
        "promised": expectation.summary,
        "seen": verdict.seen,
        "noticed_s": verdict.noticed_s,
        "settled_s": verdict.settled_s,
        "ok": verdict.is_right,
        "faults": list(verdict.faults),
        "run": None if verdict.run is None else str(verdict.run),
    }
