"""Turn the rates that nodes report into events. Pure.

Each node reports once per second. An event follows when a rate breaks, when it recovers, and when
it moves in between.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from obelisk_spec.runtime_protocol import Rate
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

__all__ = ["SILENT_S", "RateWatch"]

SILENT_S: Final = 3.0
"""Time after the last report at which a rate counts as unreported; one report may be late [s]."""
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
            is_expected = planned.promises and state.states.get(node) == ACTIVE
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
                    # Its report is late, or it has no rates, as a simulator without a fixed pace.
                    self._waiting_since[node] = now
                    continue
                self._unreported.add(node)
                yield RatesUnreported(
                    node=node,
                    measured=tuple(p.name for p in planned.promises if p.topic),
                    unknown=tuple(p.name for p in planned.promises if not p.topic),
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
