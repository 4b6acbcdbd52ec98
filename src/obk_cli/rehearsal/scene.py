"""What was seen of one case, as values, and a launcher's lines as the events that they tell. Pure.

A launcher's word on what happened is held against what is known without it: its exit code, its
answer when asked, and the processes that are left.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args

from obk_cli.launch.events import Told
from obk_cli.runs.protocol import StackStatus

__all__ = ["Moment", "Scene", "parse_moment"]

_EVENTS: Final[dict[str, Any]] = {event.__name__: event for event in get_args(Told)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """An event, and when the launcher told it."""

    time_s: float
    """[s since 1970]"""
    event: Told


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """All that was seen of one case."""

    struck_s: float
    """When the fault was made [s since 1970]."""
    run: Path
    """The launch's run folder."""
    before: StackStatus
    moments: tuple[Moment, ...]
    """From the fault on."""
    after: StackStatus | None
    """None: the launcher does not answer, or has ended."""
    exit_code: int | None
    """The launcher's; None: it runs."""
    ended_s: float | None = None
    """When the launcher's end was seen [s since 1970]."""
    left: tuple[str, ...] = ()
    """Commands of the processes that outlived their launcher."""


def parse_moment(line: str) -> Moment | None:
    """A line of `obk launch --format json`; None for one that is no event."""
    try:
        record = json.loads(line)
    except ValueError:
        return None
    if not isinstance(record, dict) or record.get("event") not in _EVENTS:
        return None
    time_s, kind = record.pop("time"), _EVENTS[record.pop("event")]
    values = {key: tuple(v) if isinstance(v, list) else v for key, v in record.items()}
    return Moment(time_s=time_s, event=kind(**values))
