"""Wire a new node: choose a topic for each of its endpoints and a period for each timer.

Pure: returns the entry with topics and periods, or the endpoint for which no topic fits.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from obelisk_spec.names import bare_name
from obelisk_spec.suggestions import list_names
from obk_cli.config.model import Node, Spanned, Stack
from obk_cli.config.topology import Direction, TopicEndpoint, node_endpoints, stack_endpoints
from obk_cli.configedit.new_node import (
    END_LISTS,
    NewEndpoint,
    NewNode,
    Rejected,
    components,
    identity_of,
)
from obk_cli.diagnostics.source import Span

__all__ = ["Link", "Tick", "Wired", "matching_types", "wire_node"]

_SOURCES: Mapping[str, tuple[str, ...]] = {
    "control": ("estimation", "robot", "sensing", "control", "joystick"),
    "estimation": ("robot", "sensing", "estimation"),
    "robot": ("control",),
    "sensing": ("robot", "sensing"),
}
"""Section -> the sections that its nodes subscribe to, the most likely first."""
_READERS: Mapping[str, tuple[str, ...]] = {
    "control": ("robot", "control"),
    "estimation": ("control", "estimation"),
    "robot": ("estimation", "control"),
    "sensing": ("estimation", "control"),
}
"""Section -> the sections that subscribe to its nodes."""
_BEFORE: Mapping[str, tuple[str, ...]] = {
    "control": ("estimation",),
    "estimation": ("robot", "sensing"),
}
"""Section -> the preceding sections in the loop; for a robot, `control`."""
_OTHER_SIDE: Mapping[Direction, Direction] = {"publishes": "subscribes", "subscribes": "publishes"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """One endpoint of the new node and its topic."""

    end: NewEndpoint
    topic: str
    """Absolute."""
    written: str
    """The topic as written in the config, with its variables."""
    peers: tuple[str, ...] = ()
    """Full names of the nodes at the other endpoint."""
    qos: Mapping[str, str] | None = None
    notes: tuple[str, ...] = ()
    """Notes for the user about the choice."""
    switch: "Switch | None" = None
    """How to make the stack use a topic that has no subscriber yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch:
    """A subscriber that currently receives from another publisher."""

    place: Span
    """The topic name to change in the config."""
    reader: str
    writer: str


class _Chooser:
    """The endpoints of a stack, without those of the node being replaced.

    The new node takes over its topics if the types fit.
    """

    def __init__(self, new_node: NewNode, stack: Stack, replaced: Node | None) -> None:
        self.near: Link | None = None
        """A topic near which to place the node's own topics."""
        self._node = new_node
        self._name = stack.name.value if stack.name else "stack"
        self._former = tuple(node_endpoints(replaced)) if replaced else ()
        replaced_name = replaced.full_name if replaced else None
        self._ends = tuple(end for end in stack_endpoints(stack) if end.owner != replaced_name)
        self._types: dict[str, str] = {}
        for end in (*self._ends, *self._former):
            if end.known_type is not None:
                self._types.setdefault(end.topic, end.known_type)

    def subscribe(self, end: NewEndpoint) -> Link | Rejected:
        """The first topic of this type that a suitable section publishes."""
        sources = self._others(end, _SOURCES)
        fitting = _first_by_topic(other for other in sources if self._fits(other, end))
        if not fitting:
            return self._no_publisher(end, sources)
        former = [topic for topic in self._former_topics(end) if topic in fitting]
        chosen = fitting[(former or list(fitting))[0]]
        rest = [topic for topic in fitting if topic != chosen.topic]
        at_the_topic = [other for other in sources if other.topic == chosen.topic]
        is_weak = any(_is_set_to(o.qos.reliability, "best_effort") for o in at_the_topic)
        return self._link(
            end,
            chosen,
            qos={"reliability": "best_effort"} if is_weak else None,
            rest=rest,
        )

    def publish(self, end: NewEndpoint) -> Link | Rejected:
        """A topic with subscribers but without a publisher; otherwise a new topic."""
        readers = self._others(end, _READERS)
        fitting = _first_by_topic(other for other in readers if self._fits(other, end))
        if not fitting and self._node.section == "control":
            return self._no_robot(end, readers)
        busy = {other.topic for other in self._ends if other.direction == "publishes"}
        former = [topic for topic in self._former_topics(end) if topic not in busy]
        free = [topic for topic in fitting if topic not in busy]
        chosen = next(iter((*(t for t in former if t in free), *free, *former)), None)
        if chosen is None:
            return self._own_topic(end, next(iter(fitting.values()), None))
        rest = [topic for topic in free if topic != chosen]
        reader = fitting.get(chosen) or next(o for o in self._former if o.topic == chosen)
        is_latched = any(
            _is_set_to(other.qos.durability, "transient_local")
            for other in self._ends
            if other.topic == chosen
        )
        return self._link(
            end,
            reader,
            qos={"durability": "transient_local"} if is_latched else None,
            rest=rest,
        )

    def _others(
        self, end: NewEndpoint, sections: Mapping[str, tuple[str, ...]]
    ) -> list[TopicEndpoint]:
        """The endpoints that may be connected to this one: by section, then in config order."""
        peer_sections = sections.get(self._node.section, ())
        side = _OTHER_SIDE[end.direction]
        candidates = [e for e in self._ends if e.direction == side and e.section in peer_sections]
        return sorted(candidates, key=lambda other: peer_sections.index(other.section))

    def _fits(self, other: TopicEndpoint, end: NewEndpoint) -> bool:
        """Whether the types are equal; if a type is not written, whether the roles match."""
        known = other.known_type or self._types.get(other.topic)
        if known is not None:
            return known == end.msg_type
        return _role(other.component or "") == _role(end.component)

    def _former_topics(self, end: NewEndpoint) -> list[str]:
        return [
            former.topic
            for former in self._former
            if former.direction == end.direction and self._fits(former, end)
        ]

    def _link(
        self,
        end: NewEndpoint,
        other: TopicEndpoint,
        *,
        qos: Mapping[str, str] | None,
        rest: Sequence[str],
    ) -> Link:
        side = _OTHER_SIDE[end.direction]
        peers = (e.owner for e in self._ends if e.topic == other.topic and e.direction == side)
        notes = [f"other topics of this type: {list_names(rest)}"] if rest else []
        if other.topic not in self._types:
            notes.append(f"its type is not specified; assumed to be {end.spelling}")
        return Link(
            end=end,
            topic=other.topic,
            written=_written(other),
            peers=tuple(dict.fromkeys(peers)),
            qos=qos,
            notes=tuple(notes),
        )

    def _own_topic(self, end: NewEndpoint, rival: TopicEndpoint | None) -> Link:
        """A new topic, with a note on how to switch subscribers to it."""
        real, written = self._parents(rival)
        taken = {other.topic for other in self._ends}
        names = (self._node.executable, f"{self._node.executable}_new")
        leaves = [f"{name}/{end.leaf}" for name in names]
        leaf = next((leaf for leaf in leaves if f"{real}/{leaf}" not in taken), leaves[-1])
        writers = (
            other.owner
            for other in self._ends
            if rival and other.topic == rival.topic and other.direction == "publishes"
        )
        link = Link(
            end=end,
            topic=f"{real}/{leaf}",
            written=f"{written}/{leaf}",
            notes=("no node in the config subscribes to it yet",),
        )
        if rival is None:
            return link
        writer = next(writers)
        return replace(
            link,
            notes=(f"nothing subscribes to it yet: `{writer}` publishes `{rival.topic}`",),
            switch=Switch(place=rival.span, reader=rival.owner, writer=writer),
        )

    def _parents(self, rival: TopicEndpoint | None) -> tuple[str, str]:
        """The prefix of new topics: in the graph, and as written in the config."""
        real, written = self._beside(rival)
        parents = real.rpartition("/")[0], written.rpartition("/")[0]
        is_whole = parents[1].count("${") == parents[1].count("}")
        return parents if is_whole else (parents[0], parents[0])

    def _beside(self, rival: TopicEndpoint | None) -> tuple[str, str]:
        """The topic next to which a new topic is placed."""
        if rival is not None:
            return rival.topic, _written(rival)
        if self.near is not None:
            return self.near.topic, self.near.written
        published = [end for end in self._ends if end.direction == "publishes"]
        sections = ("sensing", "robot", "control")
        near = (end for section in sections for end in published if end.section == section)
        first = next(near, None)
        usual = f"/obelisk/{self._name}/"
        return (first.topic, _written(first)) if first else (usual, usual)

    def _no_publisher(self, end: NewEndpoint, sources: Iterable[TopicEndpoint]) -> Rejected:
        before = _BEFORE.get(self._node.section, ("control",))
        return Rejected(
            sentence=f"nothing in {' or '.join(f'`{name}`' for name in before)} publishes "
            f"{end.spelling}, to which `{self._node.executable}` subscribes "
            f"(`{end.component}`)",
            help=self._existing_topics("published", (o for o in sources if o.section in before)),
            component=end.component,
        )

    def _no_robot(self, end: NewEndpoint, readers: Iterable[TopicEndpoint]) -> Rejected:
        robots = (other for other in readers if other.section == "robot")
        return Rejected(
            sentence=f"no robot subscribes to {end.spelling}, which "
            f"`{self._node.executable}` publishes (`{end.component}`)",
            help=self._existing_topics("subscribed to", robots),
            component=end.component,
        )

    def _existing_topics(self, verb: str, endpoints: Iterable[TopicEndpoint]) -> str:
        types = {topic: bare_name(known) for topic, known in self._types.items()}
        topics = _first_by_topic(endpoints)
        shown = [f"`{topic}` ({types.get(topic, 'type not specified')})" for topic in topics]
        more = f" and {len(shown) - 6} more" if len(shown) > 6 else ""
        if not shown:
            return f"no topic is {verb} there"
        return f"{verb}: {', '.join(shown[:6])}{more}; make the node for one of these types"


def _first_by_topic(endpoints: Iterable[TopicEndpoint]) -> dict[str, TopicEndpoint]:
    first: dict[str, TopicEndpoint] = {}
    for end in endpoints:
        first.setdefault(end.topic, end)
    return first


def _role(component: str) -> str:
    """The role of a component: `ctrl` for `pub_ctrl` and `sub_ctrl`."""
    return component.removeprefix("pub_").removeprefix("sub_")


def _is_set_to(setting: Spanned[str] | None, word: str) -> bool:
    return setting is not None and setting.value == word


def _written(end: TopicEndpoint) -> str:
    """The topic as written, with the user's variables."""
    raw = end.span.text.strip("\"'")
    is_whole = raw.startswith(("/", "${")) and raw.count("${") == raw.count("}")
    return raw if "${" in raw and is_whole else end.topic


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """A timer of the new node, and the source of its period."""

    component: str
    period_s: float
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Wired:
    """The node with its topics and periods."""

    entry: Mapping[str, object]
    links: tuple[Link, ...]
    ticks: tuple[Tick, ...]


def wire_node(new_node: NewNode, stack: Stack, replaced: Node | None = None) -> Wired | Rejected:
    """Choose a topic for every endpoint and a period for every timer.

    The new node takes over the topics of the node that it replaces, if the types fit.
    """
    chooser = _Chooser(new_node, stack, replaced)
    links: list[Link] = []
    for end in sorted(new_node.endpoints, key=lambda end: end.direction, reverse=True):
        link = chooser.subscribe(end) if end.direction == "subscribes" else chooser.publish(end)
        if isinstance(link, Rejected):
            return link
        links.append(link)
        chooser.near = chooser.near or link
    ticks = tuple(_tick(timer, new_node, stack, replaced, links) for timer in _timers(new_node))
    entry = _entry(new_node, {link.end: link for link in links}, ticks, stack)
    return Wired(entry=entry, links=tuple(links), ticks=ticks)


def _timers(new_node: NewNode) -> list[dict[str, object]]:
    return components(new_node.entry, "timers")


def _tick(
    timer: Mapping[str, object],
    new_node: NewNode,
    stack: Stack,
    replaced: Node | None,
    links: Iterable[Link],
) -> Tick:
    """The period of the neighbor's timer, otherwise that of an input, otherwise the usual one."""
    name = identity_of(timer)
    neighbours = stack.section(new_node.section)
    for node in (replaced, *neighbours) if replaced else neighbours:
        for component in node.components:
            if component.identity == name and component.timer_period_s is not None:
                period = component.timer_period_s.value
                return Tick(component=name, period_s=period, origin=f"like `{node.full_name}`")
    received = {link.topic for link in links if link.end.direction == "subscribes"}
    for end in stack_endpoints(stack):
        if end.direction == "publishes" and end.topic in received and end.rate_hz:
            origin = f"at the rate of `{end.topic}`"
            return Tick(component=name, period_s=round(1 / end.rate_hz, 9), origin=origin)
    usual = timer["timer_period_sec"]
    assert isinstance(usual, int | float)  # the entry comes from our own template
    return Tick(
        component=name, period_s=usual, origin="the usual rate, because no neighbor has one"
    )


def _entry(
    new_node: NewNode, links: Mapping[NewEndpoint, Link], ticks: Iterable[Tick], stack: Stack
) -> dict[str, object]:
    """The entry with its keys in the usual order, and a `name` if its neighbors have names."""
    by_component = {(link.end.direction, link.end.component): link for link in links.values()}
    periods = {tick.component: tick.period_s for tick in ticks}
    is_named = any(node.name for node in stack.section(new_node.section))
    entry: dict[str, object] = {}
    for key, value in new_node.entry.items():
        if key in END_LISTS:
            direction = END_LISTS[key]
            entry[key] = [
                _with_topic(component, by_component[direction, identity_of(component)])
                for component in components(new_node.entry, key)
            ]
        elif key == "timers":
            entry[key] = [
                {**timer, "timer_period_sec": periods[identity_of(timer)]}
                for timer in _timers(new_node)
            ]
        else:
            entry[key] = value
        if key == "executable" and is_named:
            entry["name"] = new_node.executable
    return entry


def _with_topic(component: Mapping[str, object], link: Link) -> dict[str, object]:
    qos = {"qos": dict(link.qos)} if link.qos else {}
    return {**component, "topic": link.written, **qos}


def matching_types(new_node: NewNode, stack: Stack, replaced: Node | None) -> Mapping[str, str]:
    """Component -> full type, for endpoints whose default type does not fit the stack.

    It uses the types of the node being replaced, otherwise those that the preceding section
    publishes and those that command a robot.
    """
    types: dict[str, str] = {}
    for end in new_node.endpoints:
        former = node_endpoints(replaced) if replaced else ()
        known = _known(other for other in former if other.direction == end.direction)
        known = known or _known(_partners(end, new_node.section, stack, replaced))
        if known and end.msg_type not in known:
            types[end.component] = known[0]
    return types


def _partners(
    end: NewEndpoint, section: str, stack: Stack, replaced: Node | None
) -> Iterable[TopicEndpoint]:
    """The endpoints to which one of the new node's endpoints must connect."""
    is_subscriber = end.direction == "subscribes"
    if not is_subscriber and section != "control":
        return ()
    sections = _BEFORE.get(section, ("control",)) if is_subscriber else ("robot",)
    replaced_name = replaced.full_name if replaced else None
    return (
        other
        for other in stack_endpoints(stack)
        if other.direction != end.direction
        and other.section in sections
        and other.owner != replaced_name
    )


def _known(endpoints: Iterable[TopicEndpoint]) -> tuple[str, ...]:
    return tuple(end.known_type for end in endpoints if end.known_type is not None)
