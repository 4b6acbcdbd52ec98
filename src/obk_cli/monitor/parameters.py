"""The tunable parameters of a running stack, read and set through its launcher.

`ParameterTable` is the panel of `obk monitor`: lines, cursor, next values. Pure.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Protocol

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import LauncherParameters
from obk_cli.introspect.tuning import (
    ChangedParameter,
    TunableParameter,
    set_parameter,
    tunable,
    value_text,
)
from obk_cli.launch.event_lines import short_name
from obk_cli.monitor.model import StackView
from obk_cli.monitor.table import TableLine
from obk_cli.ros.parameters import NodeParameter
from obk_cli.terminal import plain

__all__ = [
    "ParameterRow",
    "ParameterTable",
    "StackParameters",
    "Tuner",
    "field_text",
    "parameter_data",
]


TIMEOUT_S: Final = 2.0
"""Limit for each answer of a node [s]."""
STEPS: Final = 100
"""Number of steps of a slider."""
SLIDER: Final = 20
"""Width of a slider [columns]."""
NONE: Final = "no tunable parameters: declare them with `Parameter`"


class Tuner(Protocol):
    """The methods of `StackParameters` that monitor and page use."""

    def of(self, view: StackView) -> Mapping[str, tuple[TunableParameter, ...]]:
        """The tunable parameters by the node's full name."""
        ...

    def set(self, view: StackView, node: str, name: str, text: str) -> ChangedParameter:
        """Set a parameter."""
        ...


class StackParameters:
    """Queries the launcher of a stack on this host; other stacks show no tunable parameters."""

    def __init__(self, runs: Path) -> None:
        """Prepare; queries follow on demand.

        Args:
            runs: the folder of all runs.
        """
        self._runs = runs

    def of(self, view: StackView) -> dict[str, tuple[TunableParameter, ...]]:
        """The tunable parameters by the node's full name; nodes that do not answer are omitted."""
        found: dict[str, tuple[TunableParameter, ...]] = {}
        if not view.run or view.has_ended:
            return found
        for node in view.nodes:
            if not node.state:
                continue
            try:
                parameters = tunable(self._parameters(view, node.node))
            except CommandFailedError:
                continue
            if parameters:
                found[node.node] = parameters
        return found

    def set(self, view: StackView, node: str, name: str, text: str) -> ChangedParameter:
        """Set a parameter.

        Raises:
            ObkError: see `set_parameter`.
        """
        return set_parameter(self._parameters(view, node), node, name, text)

    def _parameters(self, view: StackView, node: str) -> LauncherParameters:
        return LauncherParameters(self._runs / view.run, node, TIMEOUT_S)


def parameter_data(parameter: TunableParameter) -> dict[str, Any]:
    """A parameter for a page; `initial` and `text` are as a person would write them."""
    notes, kind = parameter.description.notes, parameter.value.kind
    is_number = kind in ("double", "integer")
    return {
        "name": parameter.name,
        "kind": kind,
        "text": field_text(parameter.value),
        "unit": notes.unit,
        "least": notes.least if is_number else None,
        "most": notes.most if is_number else None,
        "step": step_of(parameter) if is_number else None,
        "range": notes.range,
        "choices": list(notes.choices),
        "live": notes.is_live,
        "description": parameter.description.text,
        "initial": initial_text(parameter),
    }


def field_text(value: NodeParameter) -> str:
    """A value in the form that `set_parameter` accepts; strings are not quoted."""
    return plain(str(value.value)) if value.kind == "string" else value_text(value)


def initial_text(parameter: TunableParameter) -> str | None:
    """The value in the config, or the default, as in `field_text`; None if unknown."""
    initial = parameter.description.notes.initial
    if initial is None:
        return None
    return field_text(NodeParameter(kind=parameter.value.kind, value=initial))


def step_of(parameter: TunableParameter) -> float:
    """The step of a slider: 1 for an integer, otherwise a round number near 1/1000 of the range."""
    notes = parameter.description.notes
    if parameter.value.kind == "integer" or notes.least is None or notes.most is None:
        return 1
    width = notes.most - notes.least
    return float(f"{10 ** math.floor(math.log10(width / 500)):g}") if width > 0 else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """One parameter of a node."""

    node: str
    """Full name."""
    parameter: TunableParameter

    @property
    def initial(self) -> str | None:
        """The value in the config, or the default; None if unknown."""
        return initial_text(self.parameter)

    def nudged(self, steps: int) -> str | None:
        """The value after this many steps; None if the parameter has no slider."""
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
    """The parameters on the screen, and the selected one."""

    rows: tuple[ParameterRow, ...] = ()
    cursor: int = 0
    is_read: bool = False
    """Whether the nodes have answered."""

    def read(self, found: Mapping[str, tuple[TunableParameter, ...]]) -> "ParameterTable":
        """The same table with new values; the cursor is kept if possible."""
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
        """The row of the cursor; None if there are no rows."""
        return self.rows[self.cursor] if self.rows else None

    def lines(self, width: int) -> list[TableLine]:
        """The lines of the panel."""
        if not self.rows:
            return [TableLine(text=NONE if self.is_read else "reading parameters ...", style="dim")]
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
    when = "takes effect at the next `configure` transition" if notes.is_live is False else ""
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
