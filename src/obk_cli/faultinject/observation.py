"""What was observed of a case: events parsed from the launcher's lines, and facts besides. Pure.

The facts are its exit code, its status on request and the processes that are left.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from obk_cli.launch.events import OUTPUT_EVENTS, OutputEvent
from obk_cli.runs.protocol import StackStatus

__all__ = ["Observation", "TimedEvent", "parse_event"]

_EVENTS: Final[Mapping[str, Any]] = OUTPUT_EVENTS


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEvent:
    """An event, and when the launcher reported it."""

    time_s: float
    """[s since 1970]"""
    event: OutputEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """All that was observed of one case."""

    injected_s: float
    """When the fault was injected [s since 1970]."""
    run: Path
    """The launch's run folder."""
    before: StackStatus
    events: tuple[TimedEvent, ...]
    """From the fault on."""
    after: StackStatus | None
    """None: the launcher does not respond, or has ended."""
    exit_code: int | None
    """The launcher's; None: it is running."""
    ended_s: float | None = None
    """When the launcher's end was seen [s since 1970]."""
    left: tuple[str, ...] = ()
    """Commands of the processes that outlived their launcher."""


def parse_event(line: str) -> TimedEvent | None:
    """A line of `obk launch --format json`; None if it is not an event."""
    try:
        record = json.loads(line)
    except ValueError:
        return None
    if not isinstance(record, dict) or record.get("event") not in _EVENTS:
        return None
    time_s, kind = record.pop("time"), _EVENTS[record.pop("event")]
    values = {key: tuple(v) if isinstance(v, list) else v for key, v in record.items()}
    return TimedEvent(time_s=time_s, event=kind(**values))
