"""Who is to be asked for a sign of life, and who has given none for too long.

Whoever watches may be held up itself; a node that was not asked in time is not blamed for that.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

__all__ = ["Pulse"]

PERIOD_S: Final = 0.4
"""Between questions; one may get lost."""


@dataclass(slots=True, kw_only=True)
class _Beat:
    heard: float
    asked: float | None = None
    """When it was first asked since it was last heard."""
    grace_s: float = 0.0
    """Beyond the limit, for one that said that it is busy."""


class Pulse:
    """The signs of life of those watched."""

    def __init__(self, limit_s: float) -> None:
        """Blame those who were asked and have not been heard of for `limit_s`."""
        self._limit_s = limit_s
        self._beats: dict[str, _Beat] = {}
        self._looked: float | None = None
        self._next = 0.0
        """When to ask again."""

    def watch(self, nodes: Iterable[str], now: float) -> None:
        """Watch these from now on; those watched already have just been heard."""
        for node in nodes:
            self._beats[node] = _Beat(heard=now)

    def watches(self, node: str) -> bool:
        """Whether a node is watched."""
        return node in self._beats

    def forget(self, nodes: Iterable[str]) -> None:
        """Watch these no longer."""
        for node in nodes:
            self._beats.pop(node, None)

    def heard(self, node: str, now: float, grace_s: float = 0.0) -> None:
        """A node gave a sign; it may be silent for `grace_s` longer than others after it."""
        if node in self._beats:
            self._beats[node] = _Beat(heard=now, grace_s=grace_s)

    def due(self, now: float) -> tuple[str, ...]:
        """Those to ask now: all at once, which costs a tenth of one after the other."""
        if now < self._next:
            return ()
        self._next = now + PERIOD_S
        for beat in self._beats.values():
            beat.asked = beat.asked or now
        return tuple(self._beats)

    def late(self, now: float) -> tuple[tuple[str, float], ...]:
        """Those who hang, each with how long it has been silent [s]."""
        held_up_s = 0.0 if self._looked is None else max(0.0, now - self._looked - 2 * PERIOD_S)
        self._looked = now
        for beat in self._beats.values():
            if beat.asked is not None:
                beat.asked += held_up_s
        late = []
        for node, beat in self._beats.items():
            if beat.asked is not None and now - beat.asked > self._limit_s + beat.grace_s:
                beat.asked = None  # It is asked again, and may answer yet.
                late.append((node, now - beat.heard))
        return tuple(late)

    def next_look(self, now: float) -> float | None:
        """When to look again (monotonic time [s]); None: nobody is watched."""
        return now + PERIOD_S / 2 if self._beats else None
