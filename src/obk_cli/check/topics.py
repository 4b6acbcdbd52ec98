"""OBK203 to OBK206: what is published, what is subscribed to, and whether the two ends fit."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from difflib import SequenceMatcher

from obelisk_spec.messages import bare_name, resolve_msg_type
from obelisk_spec.near import sure_name
from obk_cli.config import Spanned, Stack
from obk_cli.cures import respell
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.surroundings import Surroundings
from obk_cli.wiring import TopicEnd, stack_ends

__all__ = ["check_dangling", "check_qos", "check_types"]

_MOST_SHOWN = 3
_ONE_SEED_NAME = {
    "obelisk_sensor_msgs/msg/JointEncoders",
    "obelisk_sensor_msgs/msg/ObkJointEncoders",
}
"""The seeds write one name for the other, and what their C++ nodes take is in their code."""


def _by_topic(ends: Iterable[TopicEnd], direction: str) -> Mapping[str, list[TopicEnd]]:
    topics: dict[str, list[TopicEnd]] = defaultdict(list)
    for end in ends:
        if end.direction == direction:
            topics[end.topic].append(end)
    return topics


def check_dangling(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Topics that are subscribed to and not published, and those published and not read."""
    ends = tuple(stack_ends(stack))
    published, subscribed = _by_topic(ends, "publishes"), _by_topic(ends, "subscribes")
    publishers = [end for ends_of_topic in published.values() for end in ends_of_topic]
    lost = _types_of_lost_publishers(stack)
    suggested: set[str] = set()
    for end in ends:
        if end.direction == "publishes" or end.is_optional or end.topic in published:
            continue
        if not lost.isdisjoint((end.msg_type, None)):
            continue
        near = _nearest(end, publishers)
        suggested.update(other.topic for other in near)
        alone = len(subscribed[end.topic]) == 1
        yield _dangling(end, near, sure_name(end.topic, published) if alone else None)
    for topic, (first, *_others) in published.items():
        is_for_outside = first.section == "viz" or first.is_optional
        if topic not in subscribed and topic not in suggested and not is_for_outside:
            yield found("OBK204", f"nothing in the config reads `{topic}`", first.span)


def _types_of_lost_publishers(stack: Stack) -> set[str | None]:
    """Types of publishers whose topic could not be read, which was reported: theirs may be it."""
    components = (component for node in stack.nodes for component in node.components)
    return {
        resolve_msg_type(component.msg_type.value) if component.msg_type else None
        for component in components
        if component.kind == "publisher" and component.topic is None
    }


def _dangling(end: TopicEnd, near: list[TopicEnd], meant: str | None) -> Diagnostic:
    is_sure = meant in {other.topic for other in near}
    return found(
        "OBK203",
        f"nothing publishes `{end.topic}`, to which `{end.owner}` subscribes",
        end.span,
        help=_suggestion(near),
        related=(
            Related(message=f"`{other.topic}` is published here", span=other.span)
            for other in near[:1]
        ),
        fix=respell(end.span, end.topic, meant) if meant and is_sure else (),
    )


def _nearest(end: TopicEnd, publishers: list[TopicEnd]) -> list[TopicEnd]:
    """Publishers of other nodes that may be meant: those of the same type if there are any."""
    others = [p for p in publishers if p.owner != end.owner]
    same_type = [p for p in others if end.msg_type and _may_be_one(p.msg_type, end.msg_type)]
    unknown = [p for p in others if p.msg_type is None or end.msg_type is None]
    candidates = same_type or [p for p in unknown if _likeness(p, end) > 0.8]
    ranked = sorted(candidates, key=lambda p: -_likeness(p, end))
    return list({p.topic: p for p in reversed(ranked)}.values())[::-1][:_MOST_SHOWN]


def _likeness(one: TopicEnd, other: TopicEnd) -> float:
    return SequenceMatcher(None, one.topic, other.topic).ratio()


def _suggestion(near: list[TopicEnd]) -> str | None:
    if not near:
        return None
    names = " or ".join(
        f"`{end.topic}`" + (f" ({bare_name(end.msg_type)})" if end.msg_type else "") for end in near
    )
    return f"did you mean {names}?"


def _may_be_one(one: str | None, other: str | None) -> bool:
    return one == other or {one, other} == _ONE_SEED_NAME


def check_types(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Both ends of a topic have one type, where both are known."""
    ends = tuple(stack_ends(stack))
    published = _by_topic(ends, "publishes")
    for end in ends:
        if end.direction == "publishes" or end.msg_type is None:
            continue
        known = [p for p in published.get(end.topic, ()) if p.msg_type is not None]
        other = next((p for p in known if p.msg_type != end.msg_type), None)
        if other is not None and other.msg_type is not None:
            yield _types_differ(end, other, end.msg_type, other.msg_type)


def _types_differ(end: TopicEnd, other: TopicEnd, wanted: str, given: str) -> Diagnostic:
    is_alias = _may_be_one(wanted, given)
    return found(
        "OBK205",
        f"`{end.owner}` subscribes to `{end.topic}` as {_short(wanted)}, `{other.owner}` "
        f"publishes it as {_short(given)}",
        end.type_span or end.span,
        severity="warning" if is_alias else None,
        help=f"write {_short(wanted)} at both ends, unless the node's code takes {_short(given)}"
        if is_alias
        else None,
        related=(Related(message="the publisher", span=other.type_span or other.span),),
    )


def _short(msg_type: str) -> str:
    return f"`{msg_type.replace('/msg/', '/')}`"


def check_qos(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """No subscriber asks for more than its publishers offer.

    Source: ROS 2 documentation, "Quality of Service settings", QoS compatibilities.
    """
    ends = tuple(stack_ends(stack))
    published = _by_topic(ends, "publishes")
    for end in ends:
        if end.direction == "subscribes":
            for other in published.get(end.topic, ()):
                yield from _check_offer(end, other)


def _check_offer(end: TopicEnd, other: TopicEnd) -> Iterator[Diagnostic]:
    pairs = (
        (end.qos.reliability, "reliable", other.qos.reliability, "reliable", "best_effort"),
        (end.qos.durability, "volatile", other.qos.durability, "transient_local", "volatile"),
    )
    for wanted, default_wanted, offered, strong, weak in pairs:
        default_offered = "volatile" if weak == "volatile" else "reliable"
        wants = wanted.value if wanted else default_wanted
        offers = offered.value if offered else default_offered
        if wants == strong and offers == weak:
            yield _qos_differs(end, other, wanted, offered, (wants, offers))


def _qos_differs(
    end: TopicEnd,
    other: TopicEnd,
    wanted: Spanned[str] | None,
    offered: Spanned[str] | None,
    words: tuple[str, str],
) -> Diagnostic:
    wants, offers = words
    return found(
        "OBK206",
        f"`{end.owner}` asks for `{wants}` on `{end.topic}`, `{other.owner}` offers only "
        f"`{offers}`, so nothing would arrive",
        wanted.span if wanted else end.span,
        help=f"let the publisher offer `{wants}`, or the subscriber ask for `{offers}`",
        related=(Related(message="the publisher", span=offered.span if offered else other.span),),
    )
