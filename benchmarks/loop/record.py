"""What a node notes while it runs, and the file that it leaves. No figure is computed here.

All times are of the monotonic clock [ns], which the processes of one machine share.
"""

import json
import time
from array import array
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

__all__ = ["NodeRecord", "Notes", "phase_ns", "read_records", "record_of", "write_records"]

PHASE_LOOKS = 50


class Notes:
    """Filled by a node, at its ticks and its messages."""

    def __init__(self) -> None:
        self.ticks_ns = array("q")
        """When its timer called it."""
        self.arrivals_ns = array("q")
        """When a message came back to the simulator that it had set off; other nodes: none."""
        self.delays_ns = array("q")
        """How long each of these had been on its way."""
        self.has_heard = False
        """Whether any message came."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeRecord:
    """What a node noted, as the file has it."""

    name: str
    period_ns: int
    phase_ns: int
    """One moment at which the timer was due; all others are whole periods from it."""
    ticks_ns: tuple[int, ...]
    arrivals_ns: tuple[int, ...]
    delays_ns: tuple[int, ...]


def phase_ns(until_next_call_ns: Callable[[], int]) -> int:
    """When a timer is due, by the monotonic clock [ns].

    Args:
        until_next_call_ns: asks the timer, on whatever clock it runs.
    """
    looks = []
    for _ in range(PHASE_LOOKS):
        before_ns = time.monotonic_ns()
        left_ns = until_next_call_ns()
        after_ns = time.monotonic_ns()
        looks.append((after_ns - before_ns, (before_ns + after_ns) // 2 + left_ns))
    return min(looks)[1]


def record_of(name: str, notes: Notes, timer: Any) -> NodeRecord:
    """What a node noted, and when its rclpy timer is due."""
    # The node goes on: it may have noted an arrival and not its delay yet.
    delays_ns = tuple(notes.delays_ns)
    return NodeRecord(
        name=name,
        period_ns=timer.timer_period_ns,
        phase_ns=phase_ns(timer.time_until_next_call),
        ticks_ns=tuple(notes.ticks_ns),
        arrivals_ns=tuple(notes.arrivals_ns[: len(delays_ns)]),
        delays_ns=delays_ns,
    )


def write_records(path: Path, records: Iterable[NodeRecord]) -> None:
    """Write the file of a process."""
    path.write_text(json.dumps([asdict(record) for record in records]), encoding="utf-8")


def read_records(path: Path) -> tuple[NodeRecord, ...]:
    """Read the file of a process."""
    entries = json.loads(path.read_text(encoding="utf-8"))
    return tuple(
        NodeRecord(
            name=entry["name"],
            period_ns=entry["period_ns"],
            phase_ns=entry["phase_ns"],
            ticks_ns=tuple(entry["ticks_ns"]),
            arrivals_ns=tuple(entry["arrivals_ns"]),
            delays_ns=tuple(entry["delays_ns"]),
        )
        for entry in entries
    )
