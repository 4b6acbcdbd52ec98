"""Turn the rates that nodes report into events, and limit how many are shown. Pure.

Each node reports once per second. An event follows when a rate breaks, when it recovers, and when
it moves in between. The screen shows at most one line per node every 10 s, with counts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from obelisk_spec.runtime_protocol import Rate, hz
from obelisk_spec.suggestions import with_number
from obk_cli.launch.events import (
    OutputEvent,
    RateBroken,
    RateKept,
    RateMoved,
    RatesReported,
    RatesUnreported,
)
from obk_cli.launch.stack_state import StackState
from obk_cli.runs.lifecycle import ACTIVE

__all__ = ["INTERVAL_S", "RateSummaries", "RateSummary", "RateWatch"]

SILENT_S: Final = 3.0
"""Time after the last report at which a rate counts as unreported; one report may be late [s]."""
INTERVAL_S: Final = 10.0
"""Minimum time between two lines about the rates of one node [s]."""
MOVED: Final = 0.05
"""Minimum change that counts as moved, relative to the expected rate."""


class RateWatch:
    """Follows the rates of the nodes that run here."""

    def __init__(self, state: StackState, publishes_diagnostics: Callable[[str], bool]) -> None:
        self._state = state
        self._publishes_diagnostics = publishes_diagnostics
        self._received: dict[str, float] = {}
        """Time of each active node's last report [s]."""
        self._waiting_since: dict[str, float] = {}
        """Since when an active node's first report is due [s]."""
        self._unreported: set[str] = set()
        """Active nodes that do not report their own rates."""
        self._published: dict[tuple[str, str], Rate] = {}
        """Node and name -> the last published rate that is not as expected."""
        self._by_silence: set[tuple[str, str]] = set()
        """Published rates that are broken because nothing was reported."""

    def received(self, report: RatesReported, now: float) -> Iterator[OutputEvent]:
        """The events of a report; ignores nodes that are inactive or not part of this run."""
        node = report.node
        if self._state.states.get(node) != ACTIVE:
            return
        if not report.is_external:
            self._unreported.discard(node)
        elif node not in self._unreported:
            return  # the node now reports its own rates
        self._received[node] = now
        self._state.rates[node] = report.rates
        for rate in report.rates:
            yield from self._changes(node, rate)

    def silence(self, now: float) -> Iterator[OutputEvent]:
        """The events of active nodes that stopped reporting, or never started."""
        yield from self._unreported_rates(now)
        for node, received in list(self._received.items()):
            if self._state.states.get(node) != ACTIVE:
                self._forget(node)
            elif node in self._state.hung or node in self._state.in_transition:
                self._received[node] = now  # the heartbeat handles hung nodes
            elif now - received > SILENT_S:
                silent = tuple(
                    replace(rate, measured_hz=0.0, standing="broken")
                    for rate in self._state.rates[node]
                )
                self._state.rates[node] = silent
                for rate in silent:
                    yield from self._changes(node, rate, now - received)

    def _unreported_rates(self, now: float) -> Iterator[RatesUnreported]:
        state = self._state
        for node, planned in state.nodes.items():
            is_expected = planned.rates and state.states.get(node) == ACTIVE
            if not is_expected or node in self._received or not state.is_local(node):
                self._waiting_since.pop(node, None)
                if not is_expected:
                    self._unreported.discard(node)
            elif node in state.hung or node in state.in_transition:
                self._waiting_since[node] = now
            elif (
                now - self._waiting_since.setdefault(node, now) > SILENT_S
                and node not in self._unreported
            ):
                if self._publishes_diagnostics(node):
                    # Its report is late, or it has no rates, like a simulator without a fixed pace.
                    self._waiting_since[node] = now
                    continue
                self._unreported.add(node)
                yield RatesUnreported(
                    node=node,
                    measured=tuple(p.name for p in planned.rates if p.topic),
                    unknown=tuple(p.name for p in planned.rates if not p.topic),
                )

    def _changes(self, node: str, rate: Rate, silent_s: float = 0.0) -> Iterator[OutputEvent]:
        key = (node, rate.name)
        published = self._published.get(key)
        was_broken = published is not None and published.standing == "broken"
        # Silence does not show what is wrong; the next report does.
        was_silent = key in self._by_silence and not silent_s
        if was_silent:
            self._by_silence.discard(key)
        if rate.standing == "kept":
            if published is not None:
                del self._published[key]
                yield (RateKept if was_broken else RateMoved)(node=node, rate=rate)
            return
        breaks = rate.standing == "broken" and (was_silent or not was_broken)
        moved_hz = abs(rate.measured_hz - published.measured_hz) if published else rate.expected_hz
        if not breaks and moved_hz <= MOVED * rate.expected_hz:
            return
        self._published[key] = rate
        if breaks:
            if silent_s:
                self._by_silence.add(key)
            origin = self._state.origin_of_rate(node, rate.name)
            yield RateBroken(node=node, rate=rate, origin=origin, silent_s=silent_s)
        else:
            yield RateMoved(node=node, rate=rate)

    def _forget(self, node: str) -> None:
        del self._received[node]
        self._state.rates.pop(node, None)
        for known in [key for key in self._published if key[0] == node]:
            del self._published[known]
            self._by_silence.discard(known)


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
        f"lowest {hz(lowest)} of {hz(rate.expected_hz)} Hz, now {hz(rate.measured_hz)} Hz"
    )
