"""Record the times of a node while it runs, and write and read the file with the records.

All times are of the monotonic clock [ns], which all processes of a machine share.
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
    """The times that a node records at its ticks and messages."""

    def __init__(self) -> None:
        self.ticks_ns = array("q")
        """Times of its timer callbacks."""
        self.arrivals_ns = array("q")
        """Times at which the simulator received controls; empty for other nodes."""
        self.delays_ns = array("q")
        """Age of the sensor values behind each of these controls."""
        self.has_received = False
        """Whether the node has received any message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeRecord:
    """The record of a node in the file."""

    name: str
    period_ns: int
    phase_ns: int
    """One scheduled time of the timer; all others are whole periods away from it."""
    ticks_ns: tuple[int, ...]
    arrivals_ns: tuple[int, ...]
    delays_ns: tuple[int, ...]


def phase_ns(until_next_call_ns: Callable[[], int]) -> int:
    """A time at which a timer is due, on the monotonic clock [ns].

    Args:
        until_next_call_ns: returns the time until the next call, on any clock.
    """
    looks = []
    for _ in range(PHASE_LOOKS):
        before_ns = time.monotonic_ns()
        left_ns = until_next_call_ns()
        after_ns = time.monotonic_ns()
        looks.append((after_ns - before_ns, (before_ns + after_ns) // 2 + left_ns))
    return min(looks)[1]


def record_of(name: str, notes: Notes, timer: Any) -> NodeRecord:
    """The record of a node, with the phase of its rclpy timer."""
    # The node is still running and may have recorded an arrival but not its delay.
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
