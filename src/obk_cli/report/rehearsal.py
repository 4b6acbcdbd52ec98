"""A rehearsal's rows as a table, for a terminal or for a file, and as JSON."""

import json
from collections.abc import Iterator, Sequence
from io import StringIO
from typing import Any, Final

from obelisk_spec.wording import with_number
from obk_cli.rehearsal.judge import Row
from obk_cli.report.launch import short_name

__all__ = ["HEAD", "rehearsal_json", "rehearsal_table", "rehearsal_text"]

HEAD: Final = ("node", "fault", "promised", "seen", "noticed [s]", "settled [s]", "")
"""Titles of the columns; the last one holds the verdict."""
_NUMBERS: Final = (4, 5)
_RIGHT: Final = "ok"
_WRONG: Final = "FAILED"


def rehearsal_text(rows: Sequence[Row]) -> str:
    """The table in plain columns, what is not as promised below it, and the sum."""
    cells = [HEAD, *map(_cells, rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(HEAD))]
    lines = ["  ".join(_aligned(row, widths)).rstrip() for row in cells]
    return "\n".join((*lines, *_below(rows)))


def rehearsal_table(rows: Sequence[Row], width: int) -> str:
    """The same, drawn and coloured for a terminal of so many columns."""
    from rich import box  # rich is slow to import
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column, title in enumerate(HEAD):
        table.add_column(Text(title), justify="right" if column in _NUMBERS else "left")
    for row in rows:
        *cells, verdict = _cells(row)
        style = "green" if row.is_right else "bold red"
        table.add_row(*map(Text, cells), Text(verdict, style))
    console = Console(file=StringIO(), width=width, force_terminal=True, color_system="standard")
    with console.capture() as capture:
        console.print(table)
    drawn = (line for line in capture.get().splitlines() if line.strip())
    return "\n".join((*drawn, *_below(rows)))


def rehearsal_json(rows: Sequence[Row]) -> str:
    """The rows for a program."""
    told = {"ok": all(row.is_right for row in rows), "rows": [_data(row) for row in rows]}
    return json.dumps(told, indent=1)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        short_name(row.case.unit.name),
        row.case.fault,
        row.case.promise.words,
        row.seen,
        _seconds(row.noticed_s, 3),
        _seconds(row.settled_s, 1),
        _RIGHT if row.is_right else _WRONG,
    )


def _seconds(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> Iterator[str]:
    for column, (cell, width) in enumerate(zip(cells, widths, strict=True)):
        yield cell.rjust(width) if column in _NUMBERS else cell.ljust(width)


def _below(rows: Sequence[Row]) -> Iterator[str]:
    wrong = [row for row in rows if not row.is_right]
    for row in wrong:
        yield ""
        yield f"{row.case.fault} {short_name(row.case.unit.name)}:"
        yield from (f"  {fault}" for fault in row.faults)
        if row.run is not None:
            yield f"  see {row.run / 'launch.log'}"
    yield ""
    kept = f"{len(rows) - len(wrong)} of {with_number(len(rows), 'promise')} kept"
    yield kept if wrong else f"{with_number(len(rows), 'promise')} kept"


def _data(row: Row) -> dict[str, Any]:
    unit, promise = row.case.unit, row.case.promise
    return {
        "process": unit.name,
        "nodes": list(unit.node_names),
        "fault": row.case.fault,
        "promised": promise.words,
        "seen": row.seen,
        "noticed_s": row.noticed_s,
        "settled_s": row.settled_s,
        "ok": row.is_right,
        "faults": list(row.faults),
        "run": None if row.run is None else str(row.run),
    }
