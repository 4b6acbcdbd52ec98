"""Decide which nodes to query for a heartbeat, and which have been silent for too long. Pure.

The launcher may be delayed itself. Its own delays, and the time that it is suspended (Ctrl-Z), do
not count against any node or deadline.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

__all__ = ["SLICE_S", "AwakeClock", "Heartbeat"]

PERIOD_S: Final = 0.4
"""Time between two queries, one of which may be lost [s]."""
SLICE_S: Final = 0.5
"""Longest single wait [s]; if one takes this much longer, the launcher was suspended."""


class AwakeClock:
    """Monotonic clock that excludes time spent suspended."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Wrap a monotonic clock [s]."""
        self._clock = clock
        self._suspended_s = 0.0

    def __call__(self) -> float:
        """Monotonic time, excluding time spent suspended [s]."""
        return self._clock() - self._suspended_s

    def waited(self, start: float, longest_s: float | None) -> None:
        """Account for a finished wait.

        Args:
            start: when it started.
            longest_s: expected maximum duration; None: no limit.
        """
        passed_s = self() - start
        if longest_s is not None and passed_s > longest_s + SLICE_S:
            self._suspended_s += passed_s


@dataclass(slots=True, kw_only=True)
class _Beat:
    received: float
    queried: float | None = None
    """When the node was first queried since its last heartbeat; None: not since then."""
    grace_s: float = 0.0
    """Extra time for a node that may be busy [s]."""


class Heartbeat:
    """The heartbeats of the watched nodes."""

    def __init__(self, limit_s: float) -> None:
        """Report a node as hung if it is queried and stays silent for `limit_s`."""
        self._limit_s = limit_s
        self._beats: dict[str, _Beat] = {}
        self._checked: float | None = None
        self._next = 0.0
        """When to query again."""

    def watch(self, nodes: Iterable[str], now: float) -> None:
        """Watch these nodes from now on, as if each had just sent a heartbeat."""
        for node in nodes:
            self._beats[node] = _Beat(received=now)

    def watches(self, node: str) -> bool:
        """Whether a node is watched."""
        return node in self._beats

    def forget(self, nodes: Iterable[str]) -> None:
        """Stop watching these nodes."""
        for node in nodes:
            self._beats.pop(node, None)

    def clear(self) -> None:
        """Stop watching all nodes."""
        self._beats.clear()

    def received(self, node: str, now: float) -> None:
        """Record a heartbeat."""
        if node in self._beats:
            self._beats[node] = _Beat(received=now, grace_s=self._beats[node].grace_s)

    def allow(self, nodes: Iterable[str], now: float, grace_s: float) -> None:
        """From now on, these nodes may be silent for `grace_s` longer than usual."""
        for node in self._beats.keys() & set(nodes):
            self._beats[node] = _Beat(received=now, grace_s=grace_s)

    def due(self, now: float) -> tuple[str, ...]:
        """The nodes to query now. Querying all together costs a tenth of querying one by one."""
        if now < self._next:
            return ()
        self._next = now + PERIOD_S
        for beat in self._beats.values():
            beat.queried = beat.queried or now
        return tuple(self._beats)

    def late(self, now: float, *, is_stack_busy: bool) -> tuple[tuple[str, float], ...]:
        """The nodes that hang -> how long each has been silent [s].

        Args:
            now: monotonic time [s].
            is_stack_busy: whether nodes make transitions, which slow down the replies of the others
                on a machine with few cores; this time counts half.
        """
        passed_s = 0.0 if self._checked is None else now - self._checked
        held_up_s = max(0.0, passed_s - 2 * PERIOD_S, passed_s / 2 if is_stack_busy else 0.0)
        self._checked = now
        for beat in self._beats.values():
            if beat.queried is not None:
                beat.queried += held_up_s
        late = []
        for node, beat in self._beats.items():
            if beat.queried is not None and now - beat.queried > self._limit_s + beat.grace_s:
                beat.queried = None  # the node is queried again, and may still answer
                late.append((node, now - beat.received))
        return tuple(late)

    def next_check(self, now: float) -> float | None:
        """When to check again (monotonic time [s]); None: no node is watched."""
        return now + PERIOD_S / 2 if self._beats else None
