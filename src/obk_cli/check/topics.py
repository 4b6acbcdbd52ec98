"""OBK203 to OBK206, OBK214, OBK218: publishers and subscribers, and whether they match."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

from obelisk_spec.names import (
    OBELISK_MESSAGES,
    bare_name,
    resolve_msg_type,
    topic_name_fault,
)
from obelisk_spec.suggestions import comparable, list_names, sure_name
from obk_cli.check.context import CheckContext
from obk_cli.config.fixes import respell
from obk_cli.config.model import Qos, Spanned, Stack
from obk_cli.config.topology import Direction, TopicEndpoint, may_be_one
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found

__all__ = [
    "SHARED_TOPICS",
    "check_doubles",
    "check_qos",
    "check_sensor_topics",
    "check_types",
    "check_unconnected_topics",
]

_MOST_SHOWN = 3
_MOST_LISTED = 8
SHARED_TOPICS = ("/tf", "/tf_static", "/diagnostics", "/rosout")
"""Topics that any number of nodes may publish to."""
_OF_OBELISK = tuple(f"{package}/" for package in OBELISK_MESSAGES)
_MOST_COMPARED = 20_000
"""Maximum number of name pairs to compare; after that, findings have no suggestions."""


def check_unconnected_topics(context: CheckContext) -> Iterator[Diagnostic]:
    """Report topics without a publisher, and topics without a subscriber."""
    endpoints = context.topology.endpoints
    published, subscribed = context.topology.published, context.topology.subscribed
    publishers = _publishers_by_type(published)
    compared = 0
    lost = _types_of_lost_publishers(context.stack, endpoints)
    suggested: set[str] = set()
    unmatched: list[TopicEndpoint] = []
    for end in endpoints:
        if end.direction == "publishes" or end.is_optional or end.topic in published:
            continue
        if not lost.isdisjoint((end.msg_type, None)):
            continue
        is_compared = compared < _MOST_COMPARED
        candidates = _candidates(end, publishers) if is_compared else []
        compared += len(candidates)
        near = _nearest(end, candidates)
        if is_compared and not near:
            unmatched.append(end)
            continue
        suggested.update(other.topic for other in near)
        alone = bool(near) and len(subscribed[end.topic]) == 1
        yield _dangling(end, near, sure_name(end.topic, published) if alone else None)
    if unmatched:
        yield _not_published(unmatched)
    for topic, (first, *_others) in published.items():
        is_for_outside = first.section == "viz" or first.is_optional
        if topic not in subscribed and topic not in suggested and not is_for_outside:
            message = f"no node in the config subscribes to `{topic}`"
            yield found("OBK204", message, first.span, related=first.renamed)


def _types_of_lost_publishers(stack: Stack, endpoints: Iterable[TopicEndpoint]) -> set[str | None]:
    """Types of publishers with a missing or unresolved topic, which a subscriber may refer to.

    For a simulator, they come from its `sim` block.
    """
    lost = {
        end.msg_type
        for end in endpoints
        if end.direction == "publishes"
        and ("${" in end.topic or (end.msg_type and topic_name_fault(end.topic)))
    }
    for node in stack.nodes:
        if node.is_simulator and not node.sims:
            lost.add(None)
        for component in node.components:
            if component.kind == "publisher" and component.topic is None:
                written = component.msg_type
                lost.add(resolve_msg_type(written.value) if written else None)
    return lost


def _dangling(end: TopicEndpoint, near: list[TopicEndpoint], meant: str | None) -> Diagnostic:
    """A finding with suggestions; a warning if all of them are of another type."""
    fitting = {other.topic for other in near if not _clash(end, other)}
    return found(
        "OBK203",
        f"nothing publishes `{end.topic}`, to which `{end.owner}` subscribes",
        end.span,
        severity=None if fitting else "warning",
        help=f"{_suggestion(end, near)} If a node outside the stack publishes it, add "
        f"`external_topics: [{end.topic}]`",
        related=(
            *end.renamed,
            *(Related(message=f"`{o.topic}` is published here", span=o.span) for o in near[:1]),
            *(place for o in near[:1] for place in o.renamed),
        ),
        fix=respell(end.span, end.topic, meant) if meant and meant in fitting else (),
    )


def _not_published(endpoints: Sequence[TopicEndpoint]) -> Diagnostic:
    """One warning for all topics without similar names: they probably come from elsewhere."""
    topics = list(dict.fromkeys(end.topic for end in endpoints))
    owners = list(dict.fromkeys(end.owner for end in endpoints))
    subscribe = "subscribe" if len(owners) > 1 else "subscribes"
    return found(
        "OBK203",
        f"no node in the config publishes {list_names(topics, most=_MOST_LISTED)}, to which "
        f"{list_names(owners, most=_MOST_SHOWN)} {subscribe}",
        endpoints[0].span,
        severity="warning",
        help="if nodes outside the stack publish "
        + ("it" if len(topics) == 1 else "them")
        + f", add `external_topics: [{', '.join(topics[:_MOST_LISTED])}"
        + (", ...]`" if len(topics) > _MOST_LISTED else "]`"),
        related=(
            *endpoints[0].renamed,
            *(
                place
                for end in endpoints[1:_MOST_LISTED]
                for place in (
                    Related(message=f"`{end.topic}` is subscribed to here", span=end.span),
                    *end.renamed,
                )
            ),
        ),
    )


_ByType = Mapping[str | None, Mapping[str, list[TopicEndpoint]]]


def _publishers_by_type(published: Mapping[str, tuple[TopicEndpoint, ...]]) -> _ByType:
    """Type -> topic -> its first two publishers, because one may be the subscriber itself."""
    by_type: dict[str | None, dict[str, list[TopicEndpoint]]] = defaultdict(dict)
    for topic, endpoints in published.items():
        for end in endpoints:
            kept = by_type[end.msg_type].setdefault(topic, [])
            if not kept or (len(kept) == 1 and kept[0].owner != end.owner):
                kept.append(end)
    return by_type


def _candidates(end: TopicEndpoint, publishers: _ByType) -> list[TopicEndpoint]:
    """Publishers of other nodes to compare with.

    Those of the same type if any exist, otherwise those of unknown type, otherwise all.
    """
    alike = [kind for kind in publishers if end.msg_type and may_be_one(kind, end.msg_type)]
    unknown = [kind for kind in publishers if kind is None or end.msg_type is None]
    groups = (_of_types(end, publishers, kinds) for kinds in (alike, unknown, publishers))
    return next((group for group in groups if group), [])


def _of_types(
    end: TopicEndpoint, publishers: _ByType, kinds: Iterable[str | None]
) -> list[TopicEndpoint]:
    return [
        other
        for kind in kinds
        for topic in comparable(end.topic, publishers[kind])
        for other in publishers[kind][topic]
        if other.owner != end.owner
    ]


def _nearest(end: TopicEndpoint, candidates: Iterable[TopicEndpoint]) -> list[TopicEndpoint]:
    """Publishers that may be meant: those of the same type or with a similar name.

    A type of ROS itself is a weak hint: an `Image` may come from any camera.
    """
    likeness = {other.topic: (_likeness(other, end), other) for other in candidates}
    close = [
        (ratio, other)
        for ratio, other in likeness.values()
        if (ratio > 0.8 and _is_similar(end.topic, other.topic))
        or (_is_telling(end.msg_type) and may_be_one(end.msg_type, other.msg_type))
    ]
    return [other for _, other in sorted(close, key=lambda pair: -pair[0])][:_MOST_SHOWN]


def _is_telling(msg_type: str | None) -> bool:
    return msg_type is not None and msg_type.startswith(_OF_OBELISK)


def _likeness(one: TopicEndpoint, other: TopicEndpoint) -> float:
    return SequenceMatcher(None, one.topic, other.topic).ratio()


def _is_similar(one: str, other: str) -> bool:
    """Whether names are similar without their common namespaces: `/x/cmd` is not `/x/imu`."""
    parts, others = one.split("/"), other.split("/")
    while parts and others and parts[0] == others[0]:
        parts, others = parts[1:], others[1:]
    return SequenceMatcher(None, "/".join(parts), "/".join(others)).ratio() > 0.6


def _suggestion(end: TopicEndpoint, near: Iterable[TopicEndpoint]) -> str:
    names = " or ".join(f"`{other.topic}`{_type_of(other, end)}" for other in near)
    return f"did you mean {names}?"


def _type_of(other: TopicEndpoint, end: TopicEndpoint) -> str:
    """The other endpoint's type in parentheses, with this endpoint's type if it differs."""
    if other.msg_type is None:
        return ""
    if end.msg_type is None or end.msg_type == other.msg_type:
        return f" ({bare_name(other.msg_type)})"
    names = (bare_name(other.msg_type), bare_name(end.msg_type))
    if names[0] == names[1]:
        names = (other.msg_type.replace("/msg/", "/"), end.msg_type.replace("/msg/", "/"))
    return f" ({names[0]}, here it is {names[1]})"


def _clash(one: TopicEndpoint, other: TopicEndpoint) -> bool:
    """Whether both types are known and differ."""
    is_known = one.msg_type is not None and other.msg_type is not None
    return is_known and not may_be_one(one.msg_type, other.msg_type)


def check_doubles(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no node publishes to a topic twice; `check_types` reports different types."""
    for _, endpoints in context.topology.by_node:
        firsts: dict[str, TopicEndpoint] = {}
        for end in endpoints:
            if end.direction == "subscribes":
                continue
            first = firsts.setdefault(end.topic, end)
            is_reported = len({first.known_type, end.known_type} - {None}) > 1
            if first is not end and not is_reported:
                yield found(
                    "OBK214",
                    f"`{end.owner}` has two publishers on `{end.topic}`",
                    end.span,
                    help="give this publisher its own topic",
                    related=(
                        Related(message="the first publisher", span=first.span),
                        *first.renamed,
                        *end.renamed,
                    ),
                )


def check_sensor_topics(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that two nodes never publish to one sensor topic; `check_types` checks their types."""
    shared: dict[tuple[str, str], list[tuple[TopicEndpoint, TopicEndpoint]]] = defaultdict(list)
    for topic, endpoints in context.topology.published.items():
        measured = [end for end in endpoints if end.section in ("robot", "sensing")]
        if topic in SHARED_TOPICS or len({end.known_type for end in measured} - {None}) > 1:
            continue
        for end in measured[1:]:
            if end.owner != measured[0].owner:
                shared[measured[0].owner, end.owner].append((measured[0], end))
    for (one, other), pairs in shared.items():
        yield _shared_sensor_topics(one, other, pairs)


def _shared_sensor_topics(
    one: str, other: str, pairs: Sequence[tuple[TopicEndpoint, TopicEndpoint]]
) -> Diagnostic:
    """One finding for two nodes, however many topics both publish to."""
    topics = list(dict.fromkeys(end.topic for _, end in pairs))
    first, second = pairs[0]
    help = f"give one of them {'another topic' if len(topics) == 1 else 'other topics'}"
    if first.span.path != second.span.path:
        help += "; to replace one by the other, give both the same `name`"
    return found(
        "OBK218",
        f"both `{one}` and `{other}` publish to the sensor topic{'s' if len(topics) > 1 else ''} "
        f"{list_names(topics)}",
        second.span,
        help=help,
        related=(
            Related(message="the other one", span=first.span),
            *first.renamed,
            *second.renamed,
            *(Related(message="also this topic", span=end.span) for _, end in pairs[1:_MOST_SHOWN]),
        ),
    )


def check_qos(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no subscriber requests more than its publishers offer.

    Source: ROS 2 documentation, "Quality of Service settings", QoS compatibilities.
    """
    endpoints = context.topology.endpoints
    for policy in _POLICIES:
        weak: dict[str, list[TopicEndpoint]] = defaultdict(list)
        for end in endpoints:
            if end.is_external:
                continue  # its QoS is not known
            if end.direction == "publishes" and policy.of(end, policy.offered) == policy.weak:
                weak[end.topic].append(end)
        for end in endpoints:
            wants = policy.of(end, policy.expected)
            if (
                not end.is_external
                and end.direction == "subscribes"
                and end.topic in weak
                and wants == policy.strong
            ):
                yield _qos_differs(end, weak[end.topic], policy)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Policy:
    """A QoS policy: the names of its stronger and weaker value, and its value at an endpoint."""

    written: Callable[[Qos], Spanned[str] | None]
    strong: str
    weak: str
    expected: str
    offered: str

    def of(self, end: TopicEndpoint, default: str) -> str:
        setting = self.written(end.qos)
        return setting.value if setting else default


_POLICIES = (
    _Policy(
        written=lambda qos: qos.reliability,
        strong="reliable",
        weak="best_effort",
        expected="reliable",
        offered="reliable",
    ),
    _Policy(
        written=lambda qos: qos.durability,
        strong="transient_local",
        weak="volatile",
        expected="volatile",
        offered="volatile",
    ),
)


def _qos_differs(end: TopicEndpoint, others: list[TopicEndpoint], policy: _Policy) -> Diagnostic:
    expected, first = policy.written(end.qos), others[0]
    rest = len(others) - 1
    who = f"`{first.owner}` and {rest} more offer" if rest else f"`{first.owner}` offers"
    return found(
        "OBK206",
        f"`{end.owner}` requests `{policy.strong}` on `{end.topic}`, but {who} only "
        f"`{policy.weak}`, so the subscriber would receive nothing{' from them' if rest else ''}",
        expected.span if expected else end.span,
        help=f"use `{policy.strong}` for the publisher, or `{policy.weak}` for the subscriber",
        related=(
            *(
                Related(
                    message="the publisher" if other is first else "another one",
                    span=offered.span if (offered := policy.written(other.qos)) else other.span,
                )
                for other in others[:_MOST_SHOWN]
            ),
            *(place for e in (end, *others[:_MOST_SHOWN]) for place in e.renamed),
        ),
    )


_VERBS: Mapping[Direction, str] = {"publishes": "publishes", "subscribes": "subscribes to"}


def check_types(context: CheckContext) -> Iterator[Diagnostic]:
    """Report endpoints whose type differs from another one of the topic, if both are known."""
    by_topic: dict[str, list[TopicEndpoint]] = defaultdict(list)
    for end in context.topology.endpoints:
        if end.known_type is not None:
            by_topic[end.topic].append(end)
    for endpoints in by_topic.values():
        if len({end.known_type for end in endpoints}) > 1:
            yield from _check_topic(endpoints)


def _check_topic(endpoints: Sequence[TopicEndpoint]) -> Iterator[Diagnostic]:
    if _is_old_name(endpoints) or _is_code_alone(endpoints):
        return
    known = {end.code_type for end in endpoints if end.code_type is not None}
    right = _agreed(known) or _most_common(endpoints)
    publishers = [end for end in endpoints if end.direction == "publishes"]
    subscribers = [end for end in endpoints if end.direction == "subscribes"]
    differing = tuple(_against_other_side(publishers, subscribers, right))
    yield from differing
    if not differing:
        for side in (publishers, subscribers):
            yield from _against_own_side(side, right)


def _is_code_alone(endpoints: Sequence[TopicEndpoint]) -> bool:
    """Whether the config has one type and only the code differs, which OBK407 reports."""
    return len({end.msg_type for end in endpoints} - {None}) == 1 and any(
        end.code_type is not None and end.type_span is not None and end.code_type != end.msg_type
        for end in endpoints
    )


def _is_old_name(endpoints: Sequence[TopicEndpoint]) -> bool:
    """Whether types differ only by a type's original name, at endpoints that ignore `msg_type`."""
    binding = {end.known_type for end in endpoints if not end.ignores_type}
    first = endpoints[0].known_type
    return len(binding) <= 1 and all(may_be_one(first, end.known_type) for end in endpoints)


def _against_other_side(
    publishers: Sequence[TopicEndpoint], subscribers: Sequence[TopicEndpoint], right: str | None
) -> Iterator[Diagnostic]:
    if right is None:
        for end in subscribers:
            other = next((o for o in publishers if o.known_type != end.known_type), None)
            if other is not None:
                yield _differs(end, [other])
        return
    for own, opposite in ((publishers, subscribers), (subscribers, publishers)):
        fitting = [end for end in opposite if end.known_type == right]
        if fitting:
            yield from (_differs(end, fitting) for end in own if end.known_type != right)


def _against_own_side(
    endpoints: Sequence[TopicEndpoint], right: str | None
) -> Iterator[Diagnostic]:
    """For a topic with types on one side only: report endpoints that differ from the others."""
    fitting = [end for end in endpoints if end.known_type == right] or endpoints[:1]
    yield from (
        _differs(end, fitting) for end in endpoints if end.known_type != fitting[0].known_type
    )


def _agreed(types: Iterable[str]) -> str | None:
    """The one type in the code of all nodes; None if there are none or several."""
    every = tuple(types)
    return every[0] if len(every) == 1 else None


def _most_common(endpoints: Iterable[TopicEndpoint]) -> str | None:
    """The type of most endpoints; None if no type has the majority."""
    (first, count), (_, second) = Counter(end.known_type for end in endpoints).most_common(2)
    return first if count > second else None


def _differs(end: TopicEndpoint, others: Sequence[TopicEndpoint]) -> Diagnostic:
    """A finding at `end`, whose type differs from that of the others."""
    own, expected = end.known_type or "", others[0].known_type or ""
    is_alias = may_be_one(own, expected)
    is_note = end.ignores_type or all(other.ignores_type for other in others)
    who = f"{others[0].who} {_VERBS[others[0].direction]} it"
    if (others[0].owner, others[0].direction) == (end.owner, end.direction):
        who = "elsewhere"
    return found(
        "OBK205",
        f"{end.who} {_VERBS[end.direction]} `{end.topic}` as {_short(own)}, but {who} "
        f"as {_short(expected)}",
        end.type_span or end.span,
        severity="warning" if is_alias or is_note else None,
        help=_help(own, expected, others, is_alias=is_alias, is_note=is_note),
        related=(
            *(
                Related(message=_role_of(other, end), span=other.type_span or other.span)
                for other in others[:_MOST_SHOWN]
            ),
            *(place for e in (end, *others[:_MOST_SHOWN]) for place in e.renamed),
        ),
    )


def _role_of(other: TopicEndpoint, end: TopicEndpoint) -> str:
    if other.direction == end.direction:
        return "the other one"
    return "the publisher" if other.direction == "publishes" else "the subscriber"


def _help(
    own: str, expected: str, others: Iterable[TopicEndpoint], *, is_alias: bool, is_note: bool
) -> str | None:
    by_code = next((other for other in others if other.code_type is not None), None)
    if by_code is not None:
        verb = "publishes" if by_code.direction == "publishes" else "takes"
        return f"the code of `{by_code.owner}` {verb} {_short(expected)}"
    if is_note:
        return "a C++ node ignores `msg_type`; write the type that its code uses"
    if is_alias:
        return f"use {_short(own)} at both ends, unless the node's code requires {_short(expected)}"
    return None


def _short(msg_type: str) -> str:
    return f"`{msg_type.replace('/msg/', '/')}`"
