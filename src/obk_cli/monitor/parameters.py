"""The tunable parameters of a running stack: read by its launcher, set by its users."""

import math
from collections.abc import Mapping
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
from obk_cli.monitor.model import StackView
from obk_cli.ros.parameters import NodeParameter
from obk_cli.terminal import plain

__all__ = [
    "StackParameters",
    "Tuner",
    "field_text",
    "initial_text",
    "parameter_data",
    "step_of",
]

TIMEOUT_S: Final = 2.0
"""For each answer of a node [s]."""


class Tuner(Protocol):
    """The methods of `StackParameters` that monitor and page use."""

    def of(self, view: StackView) -> Mapping[str, tuple[TunableParameter, ...]]:
        """The tunable parameters by the node's full name."""
        ...

    def set(self, view: StackView, node: str, name: str, text: str) -> ChangedParameter:
        """Set one."""
        ...


class StackParameters:
    """Asks the launcher of a stack on this host; other stacks have no tunable parameters here."""

    def __init__(self, runs: Path) -> None:
        """Ask nothing yet.

        Args:
            runs: the folder of all runs.
        """
        self._runs = runs

    def of(self, view: StackView) -> dict[str, tuple[TunableParameter, ...]]:
        """The tunable parameters by the node's full name; nothing of nodes that do not answer."""
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
        """Set one.

        Raises:
            ObkError: see `set_parameter`.
        """
        return set_parameter(self._parameters(view, node), node, name, text)

    def _parameters(self, view: StackView, node: str) -> LauncherParameters:
        return LauncherParameters(self._runs / view.run, node, TIMEOUT_S)


def parameter_data(parameter: TunableParameter) -> dict[str, Any]:
    """A parameter for a page; `initial` and `text` are values as a person writes them."""
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
    """A value as `set_parameter` takes it back; a text stands without quotes."""
    return plain(str(value.value)) if value.kind == "string" else value_text(value)


def initial_text(parameter: TunableParameter) -> str | None:
    """The value of the config, or the default, as in `field_text`; None: unknown."""
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
