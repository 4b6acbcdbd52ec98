"""The panel of tunable parameters of `obk monitor`: lines, cursor, next values. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from obk_cli.introspect.tuning import TunableParameter, value_text
from obk_cli.launch.event_lines import short_name
from obk_cli.monitor.parameters import initial_text, step_of
from obk_cli.monitor.table import TableLine

__all__ = ["ParameterRow", "ParameterTable"]

STEPS: Final = 100
"""Steps of a slider from end to end."""
SLIDER: Final = 20
"""Width of a slider [columns]."""
NONE: Final = "no tunable parameters: declare them with `Parameter`"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """One parameter of a node."""

    node: str
    """Full name."""
    parameter: TunableParameter

    @property
    def initial(self) -> str | None:
        """The value of the config, or the default; None: unknown."""
        return initial_text(self.parameter)

    def nudged(self, steps: int) -> str | None:
        """The value so many steps further; None if the parameter has no slider."""
        notes, value = self.parameter.description.notes, self.parameter.value.value
        if isinstance(value, bool):
            return str(steps > 0).lower()
        if notes.choices and isinstance(value, str) and value in notes.choices:
            place = notes.choices.index(value) + steps
            return notes.choices[max(0, min(place, len(notes.choices) - 1))]
        if not isinstance(value, int | float) or notes.least is None or notes.most is None:
            return None
        if isinstance(value, int):
            width = max(1, round((notes.most - notes.least) / STEPS))
            return str(round(max(notes.least, min(value + steps * width, notes.most))))
        digits = step_of(self.parameter)
        new = value + steps * (notes.most - notes.least) / STEPS
        rounded = float(f"{round(new / digits) * digits:.12g}")
        return str(max(notes.least, min(rounded, notes.most)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterTable:
    """The parameters on the screen, and the one that is chosen."""

    rows: tuple[ParameterRow, ...] = ()
    cursor: int = 0
    is_read: bool = False
    """Whether the nodes have answered."""

    def read(self, found: Mapping[str, tuple[TunableParameter, ...]]) -> "ParameterTable":
        """The same table with new values; the cursor stays where it can."""
        rows = tuple(
            ParameterRow(node=node, parameter=one)
            for node, parameters in found.items()
            for one in parameters
        )
        cursor = max(0, min(self.cursor, len(rows) - 1))
        return ParameterTable(rows=rows, cursor=cursor, is_read=True)

    def moved(self, step: int) -> "ParameterTable":
        """The same table with the cursor on another row."""
        return replace(self, cursor=max(0, min(self.cursor + step, len(self.rows) - 1)))

    @property
    def chosen(self) -> ParameterRow | None:
        """The row of the cursor; None without any."""
        return self.rows[self.cursor] if self.rows else None

    def lines(self, width: int) -> list[TableLine]:
        """The lines of the panel."""
        if not self.rows:
            return [TableLine(text=NONE if self.is_read else "asking the nodes ...", style="dim")]
        cells = [_cells(row) for row in self.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = []
        for place, row in enumerate(cells):
            text = "  ".join(cell.ljust(size) for cell, size in zip(row, widths, strict=True))
            style = "reverse" if place == self.cursor else ""
            lines.append(TableLine(text=text[:width].ljust(width), style=style))
        return lines


def _cells(row: ParameterRow) -> tuple[str, ...]:
    one, notes = row.parameter, row.parameter.description.notes
    is_changed = row.initial is not None and one.value.value != notes.initial
    changed = f"was {row.initial}" if is_changed else ""
    when = "at the next configure" if notes.is_live is False else ""
    limits = notes.range or ", ".join(notes.choices)
    return (
        short_name(row.node),
        one.name,
        _slider(row),
        value_text(one.value),
        notes.unit,
        changed,
        "; ".join(filter(None, (limits, one.description.text, when))),
    )


def _slider(row: ParameterRow) -> str:
    notes, value = row.parameter.description.notes, row.parameter.value.value
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or notes.least is None or notes.most is None or notes.most <= notes.least:
        return ""
    assert isinstance(value, int | float)
    place = round((value - notes.least) / (notes.most - notes.least) * (SLIDER - 1))
    place = max(0, min(place, SLIDER - 1))
    return "─" * place + "●" + "─" * (SLIDER - 1 - place)
