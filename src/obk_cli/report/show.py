"""Messages of one topic shown one after another, whole or the fields that are selected."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from obk_cli.introspect.field_path import MISSING, Selection, selected
from obk_cli.introspect.message_dict import Plain, columns, plain_data
from obk_cli.report.messages import csv_row, json_line, message_text

__all__ = ["Shower"]


class Shower:
    """Gives the lines for each message."""

    def __init__(
        self,
        selections: Sequence[Selection],
        format: str,
        *,
        is_whole: bool,
        warn: Callable[[str], None],
    ) -> None:
        """Begin before the first message.

        Args:
            selections: the fields that are wanted; none: all.
            format: `text`, `json` or `csv`.
            is_whole: whether long arrays are shown to their end in text.
            warn: takes a sentence when something is odd.
        """
        self._selections = selections
        self._format = format
        self._is_whole = is_whole
        self._warn = warn
        self._columns: dict[str, None] = {}
        self._has_warned = False

    def lines(self, message: Any) -> Iterator[str]:
        """What is shown of a message."""
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
        """A row has the columns of the first one, so that each stays what its name says."""
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
                f"a message has {len(more)} columns more than the first one, from `{more[0]}` on; "
                "such are left out, JSON has them"
            )
        yield csv_row(cells.get(name) for name in self._columns)
