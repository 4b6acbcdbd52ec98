"""Which nodes to ask for a sign of life, and which have not answered for too long. Pure.

The launcher may be held up itself: its own delays, and the time that it spends suspended (Ctrl-Z),
count against no node and no deadline.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

__all__ = ["SLICE_S", "AwakeClock", "Heartbeat"]

PERIOD_S: Final = 0.4
"""Between two questions; one may get lost."""
SLICE_S: Final = 0.5
"""The longest single wait [s]; one that takes this much longer means that the launcher stood still.
"""


class AwakeClock:
    """Monotonic clock that excludes time spent suspended."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Start from a monotonic clock [s]."""
        self._clock = clock
        self._suspended_s = 0.0

    def __call__(self) -> float:
        """Monotonic time without that spent suspended [s]."""
        return self._clock() - self._suspended_s

    def waited(self, begin: float, longest_s: float | None) -> None:
        """Take note of a finished wait.

        Args:
            begin: when it began.
            longest_s: how long it should have taken at most; None: no limit.
        """
        passed_s = self() - begin
        if longest_s is not None and passed_s > longest_s + SLICE_S:
            self._suspended_s += passed_s


@dataclass(slots=True, kw_only=True)
class _Beat:
    received: float
    asked: float | None = None
    """When the node was first asked since its last sign of life."""
    grace_s: float = 0.0
    """Beyond the limit, for a node that announced that it is busy."""


class Heartbeat:
    """The signs of life of the watched nodes."""

    def __init__(self, limit_s: float) -> None:
        """Report a node that was asked and has been silent for `limit_s` as hung."""
        self._limit_s = limit_s
        self._beats: dict[str, _Beat] = {}
        self._checked: float | None = None
        self._next = 0.0
        """When to ask again."""

    def watch(self, nodes: Iterable[str], now: float) -> None:
        """Watch these nodes from now on, as if each had just given a sign of life."""
        for node in nodes:
            self._beats[node] = _Beat(received=now)

    def watches(self, node: str) -> bool:
        """Whether a node is watched."""
        return node in self._beats

    def forget(self, nodes: Iterable[str]) -> None:
        """Watch these nodes no longer."""
        for node in nodes:
            self._beats.pop(node, None)

    def clear(self) -> None:
        """Watch no node."""
        self._beats.clear()

    def received(self, node: str, now: float, grace_s: float = 0.0) -> None:
        """A node gave a sign of life; it may be silent `grace_s` longer than others after it."""
        if node in self._beats:
            self._beats[node] = _Beat(received=now, grace_s=grace_s)

    def due(self, now: float) -> tuple[str, ...]:
        """The nodes to ask now: all at once, which costs a tenth of one after the other."""
        if now < self._next:
            return ()
        self._next = now + PERIOD_S
        for beat in self._beats.values():
            beat.asked = beat.asked or now
        return tuple(self._beats)

    def late(self, now: float) -> tuple[tuple[str, float], ...]:
        """The nodes that hang, each with how long it has been silent [s]."""
        held_up_s = 0.0 if self._checked is None else max(0.0, now - self._checked - 2 * PERIOD_S)
        self._checked = now
        for beat in self._beats.values():
            if beat.asked is not None:
                beat.asked += held_up_s
        late = []
        for node, beat in self._beats.items():
            if beat.asked is not None and now - beat.asked > self._limit_s + beat.grace_s:
                beat.asked = None  # It is asked again, and may answer yet.
                late.append((node, now - beat.received))
        return tuple(late)

    def next_check(self, now: float) -> float | None:
        """When to check again (monotonic time [s]); None: no node is watched."""
        return now + PERIOD_S / 2 if self._beats else None
