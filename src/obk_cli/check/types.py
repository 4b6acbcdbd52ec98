"""OBK205: both ends of a topic have one type, told at the end that is to change."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence

from obk_cli.check.context import CheckContext
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.wiring import Direction, TopicEnd, may_be_one

__all__ = ["check_types"]

_MOST_SHOWN = 3
_VERBS: Mapping[Direction, str] = {"publishes": "publishes", "subscribes": "subscribes to"}


def check_types(context: CheckContext) -> Iterator[Diagnostic]:
    """Ends whose type another end of the topic does not have, where both are known."""
    by_topic: dict[str, list[TopicEnd]] = defaultdict(list)
    for end in context.topology.ends:
        if end.known_type is not None:
            by_topic[end.topic].append(end)
    for ends in by_topic.values():
        if len({end.known_type for end in ends}) > 1:
            yield from _check_topic(ends)


def _check_topic(ends: Sequence[TopicEnd]) -> Iterator[Diagnostic]:
    known = {end.code_type for end in ends if end.code_type is not None}
    right = _agreed(known) or _most_common(ends)
    publishers = [end for end in ends if end.direction == "publishes"]
    subscribers = [end for end in ends if end.direction == "subscribes"]
    told = tuple(_against_other_side(publishers, subscribers, right))
    yield from told
    if not told:
        for side in (publishers, subscribers):
            yield from _against_own_side(side, right)


def _against_other_side(
    publishers: Sequence[TopicEnd], subscribers: Sequence[TopicEnd], right: str | None
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


def _against_own_side(ends: Sequence[TopicEnd], right: str | None) -> Iterator[Diagnostic]:
    """For a topic whose other side says nothing of its type: those of one side agree, too."""
    fitting = [end for end in ends if end.known_type == right] or ends[:1]
    yield from (_differs(end, fitting) for end in ends if end.known_type != fitting[0].known_type)


def _agreed(types: Iterable[str]) -> str | None:
    """The one type that the code of all nodes says, None where it says none or several."""
    every = tuple(types)
    return every[0] if len(every) == 1 else None


def _most_common(ends: Iterable[TopicEnd]) -> str | None:
    """The type that more ends have than any other, None where that is not clear."""
    (first, count), (_, second) = Counter(end.known_type for end in ends).most_common(2)
    return first if count > second else None


def _differs(end: TopicEnd, others: Sequence[TopicEnd]) -> Diagnostic:
    """A finding at `end`, whose type is not that of the others."""
    own, wanted = end.known_type or "", others[0].known_type or ""
    is_alias = may_be_one(own, wanted)
    who = f"`{others[0].owner}` {_VERBS[others[0].direction]} it"
    if (others[0].owner, others[0].direction) == (end.owner, end.direction):
        who = "and elsewhere"
    return found(
        "OBK205",
        f"`{end.owner}` {_VERBS[end.direction]} `{end.topic}` as {_short(own)}, {who} "
        f"as {_short(wanted)}",
        end.type_span or end.span,
        severity="warning" if is_alias else None,
        help=_help(own, wanted, others, is_alias=is_alias),
        related=(
            Related(
                message=_said_of(other, end),
                span=other.type_span or other.span,
            )
            for other in others[:_MOST_SHOWN]
        ),
    )


def _said_of(other: TopicEnd, end: TopicEnd) -> str:
    if other.direction == end.direction:
        return "the other one"
    return "the publisher" if other.direction == "publishes" else "the subscriber"


def _help(own: str, wanted: str, others: Iterable[TopicEnd], *, is_alias: bool) -> str | None:
    by_code = next((other for other in others if other.code_type is not None), None)
    if by_code is not None:
        verb = "publishes" if by_code.direction == "publishes" else "takes"
        return f"the code of `{by_code.owner}` {verb} {_short(wanted)}"
    if is_alias:
        return f"write {_short(own)} at both ends, unless the node's code takes {_short(wanted)}"
    return None


def _short(msg_type: str) -> str:
    return f"`{msg_type.replace('/msg/', '/')}`"
