"""What the nodes of a run say of their rates, and what of that is news.

In: reports of nodes, a second apart, and the time. Out: events, one when a rate breaks and one when
it is kept again, and in between where it has moved.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from obelisk_spec.rates import Rate
from obk_cli.launch.events import RateBroken, RateKept, RateMoved, RatesHeard, Told
from obk_cli.launch.roster import Roster
from obk_cli.runs.lifecycle import ACTIVE

__all__ = ["SILENT_S", "RateWatch"]

SILENT_S: Final = 3.0
"""Without a report after others; they come once a second, and one may be late [s]."""
MOVED: Final = 0.05
"""Of the promised rate; less is no news."""


class RateWatch:
    """Follows the promises of the nodes that run here."""

    def __init__(self, roster: Roster) -> None:
        """Begin with nothing heard."""
        self._roster = roster
        self._heard: dict[str, float] = {}
        """When each node that is active was heard of last [s]."""
        self._told: dict[tuple[str, str], Rate] = {}
        """By node and name, what was told last of rates that are not kept."""
        self._by_silence: set[tuple[str, str]] = set()
        """Of those the ones that are told as broken because nothing was reported."""

    def heard(self, heard: RatesHeard, now: float) -> Iterator[Told]:
        """A node reported; one that is not active, or not of this run, is left aside."""
        node = heard.node
        if self._roster.states.get(node) != ACTIVE:
            return
        self._heard[node] = now
        self._roster.rates[node] = heard.rates
        for rate in heard.rates:
            yield from self._news(node, rate)

    def silence(self, now: float) -> Iterator[Told]:
        """The rates of nodes that are active and have stopped to report."""
        for node, heard in list(self._heard.items()):
            if self._roster.states.get(node) != ACTIVE:
                self._forget(node)
            elif node in self._roster.hung or node in self._roster.in_transition:
                self._heard[node] = now  # That is dealt with elsewhere.
            elif now - heard > SILENT_S:
                silent = tuple(
                    replace(rate, measured_hz=0.0, standing="broken")
                    for rate in self._roster.rates[node]
                )
                self._roster.rates[node] = silent
                for rate in silent:
                    yield from self._news(node, rate, now - heard)

    def _news(self, node: str, rate: Rate, silent_s: float = 0.0) -> Iterator[Told]:
        key = (node, rate.name)
        told = self._told.get(key)
        was_broken = told is not None and told.standing == "broken"
        # That nothing was reported does not say what is wrong; the report that comes then does.
        was_silent = key in self._by_silence and not silent_s
        if was_silent:
            self._by_silence.discard(key)
        if rate.standing == "kept":
            if told is not None:
                del self._told[key]
                yield (RateKept if was_broken else RateMoved)(node=node, rate=rate)
            return
        breaks = rate.standing == "broken" and (was_silent or not was_broken)
        moved_hz = abs(rate.measured_hz - told.measured_hz) if told else rate.wanted_hz
        if not breaks and moved_hz <= MOVED * rate.wanted_hz:
            return
        self._told[key] = rate
        if breaks:
            if silent_s:
                self._by_silence.add(key)
            origin = self._roster.origin_of_promise(node, rate.name)
            yield RateBroken(node=node, rate=rate, origin=origin, silent_s=silent_s)
        else:
            yield RateMoved(node=node, rate=rate)

    def _forget(self, node: str) -> None:
        del self._heard[node]
        self._roster.rates.pop(node, None)
        for told in [key for key in self._told if key[0] == node]:
            del self._told[told]
            self._by_silence.discard(told)
