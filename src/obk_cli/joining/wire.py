"""A new node's entry with topics and periods in it, taken from the stack that it joins.

A newcomer and the stack in; the entry and what it was wired to out, or which end nothing fits.
Reads no text and writes none.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from obk_cli.config.model import Node, Stack
from obk_cli.config.topology import stack_ends
from obk_cli.joining.choose import Chooser, Link
from obk_cli.joining.newcomer import (
    END_LISTS,
    Newcomer,
    NewEnd,
    components,
    identity_of,
)
from obk_cli.joining.refusal import Refused

__all__ = ["Tick", "Wired", "wire_newcomer"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """A timer of the new node, and where its period is from."""

    component: str
    period_s: float
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Wired:
    """The node with its topics and periods."""

    entry: Mapping[str, object]
    links: tuple[Link, ...]
    ticks: tuple[Tick, ...]


def wire_newcomer(
    newcomer: Newcomer, stack: Stack, replaced: Node | None = None
) -> Wired | Refused:
    """Choose a topic for every end and a period for every timer.

    The node that is `replaced` leaves its topics to the new one, where the types fit.
    """
    chooser = Chooser(newcomer, stack, replaced)
    links: list[Link] = []
    for end in sorted(newcomer.ends, key=lambda end: end.direction, reverse=True):
        link = chooser.subscribe(end) if end.direction == "subscribes" else chooser.publish(end)
        if isinstance(link, Refused):
            return link
        links.append(link)
        chooser.near = chooser.near or link
    ticks = tuple(_tick(timer, newcomer, stack, replaced, links) for timer in _timers(newcomer))
    entry = _entry(newcomer, {link.end: link for link in links}, ticks, stack)
    return Wired(entry=entry, links=tuple(links), ticks=ticks)


def _timers(newcomer: Newcomer) -> list[dict[str, object]]:
    return components(newcomer.entry, "timers")


def _tick(
    timer: Mapping[str, object],
    newcomer: Newcomer,
    stack: Stack,
    replaced: Node | None,
    links: Iterable[Link],
) -> Tick:
    """The period of the neighbour's timer, else of what the node hears, else the usual one."""
    name = identity_of(timer)
    neighbours = stack.section(newcomer.section)
    for node in (replaced, *neighbours) if replaced else neighbours:
        for component in node.components:
            if component.identity == name and component.timer_period_s is not None:
                period = component.timer_period_s.value
                return Tick(component=name, period_s=period, origin=f"as `{node.full_name}`")
    heard = {link.topic for link in links if link.end.direction == "subscribes"}
    for end in stack_ends(stack):
        if end.direction == "publishes" and end.topic in heard and end.rate_hz:
            origin = f"as often as `{end.topic}` comes"
            return Tick(component=name, period_s=round(1 / end.rate_hz, 9), origin=origin)
    usual = timer["timer_period_sec"]
    assert isinstance(usual, int | float)  # the entry is one of our own
    return Tick(component=name, period_s=usual, origin="the usual rate, no neighbour has one")


def _entry(
    newcomer: Newcomer, links: Mapping[NewEnd, Link], ticks: Iterable[Tick], stack: Stack
) -> dict[str, object]:
    """The entry in the order of its keys, with a `name` where the neighbours have names."""
    by_component = {(link.end.direction, link.end.component): link for link in links.values()}
    periods = {tick.component: tick.period_s for tick in ticks}
    is_named = any(node.name for node in stack.section(newcomer.section))
    entry: dict[str, object] = {}
    for key, value in newcomer.entry.items():
        if key in END_LISTS:
            direction = END_LISTS[key]
            entry[key] = [
                _with_topic(component, by_component[direction, identity_of(component)])
                for component in components(newcomer.entry, key)
            ]
        elif key == "timers":
            entry[key] = [
                {**timer, "timer_period_sec": periods[identity_of(timer)]}
                for timer in _timers(newcomer)
            ]
        else:
            entry[key] = value
        if key == "executable" and is_named:
            entry["name"] = newcomer.executable
    return entry


def _with_topic(component: Mapping[str, object], link: Link) -> dict[str, object]:
    qos = {"qos": dict(link.qos)} if link.qos else {}
    return {**component, "topic": link.written, **qos}
