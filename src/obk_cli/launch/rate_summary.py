"""Limit the lines about a node's rates on the screen to one in 10 s, with counts. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, Literal

from obelisk_spec.runtime_protocol import Rate
from obelisk_spec.suggestions import with_number
from obk_cli.launch.events import RateBroken, RateKept, RateMoved

__all__ = ["INTERVAL_S", "RateSummaries", "RateSummary"]

INTERVAL_S: Final = 10.0
"""Minimum time between two lines about the rates of one node [s]."""


Standing = Literal["broken", "unsteady", "kept"]
"""`unsteady`: all rates are as expected now, but one broke since the last line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RateSummary:
    """What the rates of a node did since the last line about them."""

    node: str
    text: str
    now: Standing


@dataclass(slots=True, kw_only=True)
class _Interval:
    """The time since the last line about a node's rates."""

    begin_s: float
    shown: str = ""
    """The rate whose break is in that line; empty if there is none."""
    breaks: dict[str, int] = field(default_factory=dict)
    """Rate -> how often it broke, including a break that was shown."""
    lowest: dict[str, Rate] = field(default_factory=dict)
    pending: dict[str, RateBroken | RateKept] = field(default_factory=dict)
    """Rate -> its last event, for rates with events that were not shown."""

    def note(self, event: RateBroken | RateKept | RateMoved) -> None:
        name, rate = event.rate.name, event.rate
        if isinstance(event, RateBroken):
            self.breaks[name] = self.breaks.get(name, 0) + 1
        if not isinstance(event, RateKept):
            known = self.lowest.get(name, rate)
            self.lowest[name] = min(known, rate, key=lambda r: r.measured_hz)

    def repeats(self, name: str) -> bool:
        """Whether a rate broke after the last line."""
        return self.breaks.get(name, 0) > (name == self.shown)


class RateSummaries:
    """Decides which events of rates are shown at once, and sums up the others."""

    def __init__(self) -> None:
        self._intervals: dict[str, _Interval] = {}
        """Node -> its interval, until one passes without events to sum up."""

    def is_shown(self, event: RateBroken | RateKept | RateMoved, now: float) -> bool:
        """Whether an event at time `now` [s] is shown; otherwise a summary counts it."""
        interval = self._intervals.get(event.node)
        if interval is None:
            if isinstance(event, RateMoved):
                return False
            shown = event.rate.name if isinstance(event, RateBroken) else ""
            interval = self._intervals[event.node] = _Interval(begin_s=now, shown=shown)
            interval.note(event)
            return True
        interval.note(event)
        if not isinstance(event, RateMoved):
            interval.pending[event.rate.name] = event
        return False

    def due(self, now: float) -> Iterator[RateSummary]:
        """The summaries of the intervals that have ended at time `now` [s]."""
        for node, interval in list(self._intervals.items()):
            if now - interval.begin_s < INTERVAL_S:
                continue
            del self._intervals[node]
            if interval.pending:
                self._intervals[node] = _Interval(begin_s=now)
                yield _summary(node, interval, now)

    def rest(self, now: float) -> Iterator[RateSummary]:
        """The summaries of all intervals at time `now` [s], which ends them."""
        ended, self._intervals = self._intervals, {}
        return (_summary(node, each, now) for node, each in ended.items() if each.pending)


def _summary(node: str, interval: _Interval, now: float) -> RateSummary:
    pending = interval.pending
    standing: Standing = "kept"
    if any(isinstance(event, RateBroken) for event in pending.values()):
        standing = "broken"
    elif any(map(interval.repeats, pending)):
        standing = "unsteady"
    return RateSummary(
        node=node,
        text="; ".join(_change(interval, event, now) for event in pending.values()),
        now=standing,
    )


def _change(interval: _Interval, event: RateBroken | RateKept, now: float) -> str:
    """`timer_ctrl missed its rate 3 times in 10 s, lowest 150 of 1000 Hz, now 990 Hz`."""
    rate, breaks = event.rate, interval.breaks.get(event.rate.name, 0)
    if not interval.repeats(rate.name):
        return f"{rate} again"
    if breaks == 1 and isinstance(event, RateBroken):
        return event.how
    lowest = interval.lowest[rate.name].measured_hz
    return (
        f"{rate.name} missed its rate {with_number(breaks, 'time')} "
        f"in {now - interval.begin_s:.0f} s, "
        f"lowest {lowest:.4g} of {rate.expected_hz:.4g} Hz, now {rate.measured_hz:.4g} Hz"
    )
