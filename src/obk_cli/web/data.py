"""A running stack and its curves as data for the page."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

from obk_cli.introspect.lifecycle import possible_transitions
from obk_cli.monitor.model import StackView
from obk_cli.monitor.table import monitor_data
from obk_cli.report.escapes import plain
from obk_cli.report.messages import json_line
from obk_cli.web.traces import Sample

__all__ = ["event", "lines_data", "samples_data", "view_data"]

_SECOND: Final = 1e-9


def view_data(view: StackView) -> dict[str, Any]:
    """A stack without its log, and with the transitions that it can be asked for."""
    data = monitor_data(view)
    del data["lines"]
    data["transitions"] = possible_transitions(view.state)
    data["nodes"] = [
        {**node, "transitions": possible_transitions(node["state"])} for node in data["nodes"]
    ]
    return data


def lines_data(lines: Iterable[str]) -> list[str]:
    """Lines of a log without what is meant for a terminal."""
    return [plain(line) for line in lines]


def samples_data(samples: Sequence[Sample]) -> list[list[float | None]]:
    """Rows: a time [s since 1970], then the values."""
    return [[at_ns * _SECOND, *values] for at_ns, values in samples]


def event(name: str, data: dict[str, Any]) -> str:
    """A message of a stream of events.

    Source: https://html.spec.whatwg.org/multipage/server-sent-events.html
    """
    return f"event: {name}\ndata: {json_line(data)}\n\n"
