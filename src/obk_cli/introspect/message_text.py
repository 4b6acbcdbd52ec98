"""Format messages as text: whole, by field, or as a table."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from obk_cli.ros.field_path import MISSING, Selection, selected
from obk_cli.ros.message_data import Plain, columns, plain_data
from obk_cli.terminal import escaped

__all__ = ["MOST_ITEMS", "MOST_LETTERS", "MessageFormatter", "csv_row", "json_line", "message_text"]

MOST_ITEMS: Final = 12
"""Maximum number of array elements shown in text."""
MOST_LETTERS: Final = 200
"""Maximum number of characters of a string shown in text."""


def message_text(value: Plain, *, is_whole: bool) -> Iterator[str]:
    """The lines of a message, or of a value in one.

    Args:
        value: plain data.
        is_whole: whether long arrays and strings are shown in full.
    """
    if isinstance(value, dict):
        yield from _fields(value, is_whole) if value else ("{}",)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        yield from _items(value, is_whole)
    else:
        yield _flow(value, is_whole)


def csv_row(values: Iterable[Plain]) -> str:
    """One CSV row without its line break; None is an empty cell."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow([_cell(value) for value in values])
    return line.getvalue()


def json_line(value: Plain) -> str:
    """The value on one line; numbers that JSON lacks are the strings `nan`, `inf`, `-inf`."""
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value))


def _fields(message: Mapping[str, Plain], is_whole: bool) -> Iterator[str]:
    for name, value in message.items():
        first, *rest = message_text(value, is_whole=is_whole)
        is_block = isinstance(value, dict) and value
        if is_block or first.startswith("- "):
            yield f"{name}:"
            yield from (f"  {line}" for line in (first, *rest))
        else:
            yield f"{name}: {first}"


def _items(items: list[Plain], is_whole: bool) -> Iterator[str]:
    shown = items if is_whole else items[:MOST_ITEMS]
    for item in shown:
        first, *rest = message_text(item, is_whole=is_whole)
        yield f"- {first}"
        yield from (f"  {line}" for line in rest)
    if len(shown) < len(items):
        yield f"# and {len(items) - len(shown)} more"


def _flow(value: Plain, is_whole: bool) -> str:
    if isinstance(value, list):
        shown = value if is_whole else value[:MOST_ITEMS]
        more = [f"... {len(value) - len(shown)} more"] if len(shown) < len(value) else []
        return f"[{', '.join([*(_flow(item, is_whole) for item in shown), *more])}]"
    if isinstance(value, str):
        text = value if is_whole or len(value) <= MOST_LETTERS else f"{value[:MOST_LETTERS]}..."
        return escaped(json.dumps(text, ensure_ascii=False))
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float) and not math.isfinite(value):
        return f"{value}".replace("nan", ".nan").replace("inf", ".inf")
    return f"{value}"


def _cell(value: Plain) -> Plain:
    if isinstance(value, bool):
        return "true" if value else "false"
    return escaped(value) if isinstance(value, str) else value


def _finite(value: Plain) -> Plain:
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


class MessageFormatter:
    """Formats the lines of each message."""

    def __init__(
        self,
        selections: Sequence[Selection],
        format: str,
        *,
        is_whole: bool,
        warn: Callable[[str], None],
    ) -> None:
        """Prepare for the first message.

        Args:
            selections: the fields to show; empty: all.
            format: `text`, `json` or `csv`.
            is_whole: whether long arrays are shown in full in text.
            warn: receives warnings.
        """
        self._selections = selections
        self._format = format
        self._is_whole = is_whole
        self._warn = warn
        self._columns: dict[str, None] = {}
        self._has_warned = False

    def lines(self, message: Any) -> Iterator[str]:
        """The lines shown for a message."""
        if not self._selections:
            value = plain_data(message)
            yield from self._lines({"": value} if not isinstance(value, dict) else value, value)
            return
        values = {}
        for selection in self._selections:
            value = selected(message, selection)
            values[selection.text] = None if value is MISSING else plain_data(value)
        only = next(iter(values.values())) if len(values) == 1 else values
        yield from self._lines(values, only)

    def _lines(self, values: dict[str, Plain], shown: Plain) -> Iterator[str]:
        if self._format == "csv":
            yield from self._rows(values)
        elif self._format == "json":
            yield json_line(values)
        else:
            yield from message_text(shown, is_whole=self._is_whole)
            if isinstance(shown, dict):
                yield "---"

    def _rows(self, values: dict[str, Plain]) -> Iterator[str]:
        """A row with the columns of the first one, so that each value matches its header."""
        cells = {
            name: cell for field, value in values.items() for name, cell in columns(value, field)
        }
        if not self._columns:
            if not cells:
                return
            self._columns = dict.fromkeys(cells)
            yield csv_row(self._columns)
        more = [name for name in cells if name not in self._columns]
        if more and not self._has_warned:
            self._has_warned = True
            self._warn(
                f"a message has {len(more)} more columns than the first one, starting with "
                f"`{more[0]}`; they are omitted (use JSON to see them)"
            )
        yield csv_row(cells.get(name) for name in self._columns)
