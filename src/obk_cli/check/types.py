"""OBK205: both ends of a topic have one type, told at the end that is to change."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence

from obk_cli.config import Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.surroundings import Surroundings
from obk_cli.wiring import TopicEnd, may_be_one, stack_ends

__all__ = ["check_types"]

_MOST_SHOWN = 3


def check_types(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Ends whose type another end of the topic does not have, where both are known."""
    by_topic: dict[str, list[TopicEnd]] = defaultdict(list)
    for end in stack_ends(stack):
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


def _agreed(types: Iterable[str]) -> str | None:
    """The one type that the code of all nodes says, None where it says none or several."""
    every = tuple(types)
    return every[0] if len(every) == 1 else None


def _most_common(ends: Iterable[TopicEnd]) -> str | None:
    """The type that more ends have than any other, None where that is not clear."""
    (first, count), (_, second) = Counter(end.known_type for end in ends).most_common(2)
    return first if count > second else None


def _differs(end: TopicEnd, others: Sequence[TopicEnd]) -> Diagnostic:
    """A finding at `end`, whose type is not that of the others, at the topic's other side."""
    own, wanted = end.known_type or "", others[0].known_type or ""
    is_alias = may_be_one(own, wanted)
    publishes = end.direction == "publishes"
    first, second = ("publishes", "subscribes to") if publishes else ("subscribes to", "publishes")
    return found(
        "OBK205",
        f"`{end.owner}` {first} `{end.topic}` as {_short(own)}, `{others[0].owner}` {second} it "
        f"as {_short(wanted)}",
        end.type_span or end.span,
        severity="warning" if is_alias else None,
        help=_help(own, wanted, others, is_alias=is_alias),
        related=(
            Related(
                message="the subscriber" if publishes else "the publisher",
                span=other.type_span or other.span,
            )
            for other in others[:_MOST_SHOWN]
        ),
    )


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
