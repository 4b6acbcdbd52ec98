"""Which message types a new node should have so that it can join a stack.

A newcomer with the usual types and the stack in; the types to take in their place out. Reads no
text and chooses no topic.
"""

from collections.abc import Iterable, Mapping

from obk_cli.config.model import Node, Stack
from obk_cli.config.topology import TopicEnd, node_ends, stack_ends
from obk_cli.joining.choose import BEFORE
from obk_cli.joining.newcomer import Newcomer, NewEnd

__all__ = ["suit_types"]


def suit_types(newcomer: Newcomer, stack: Stack, replaced: Node | None) -> Mapping[str, str]:
    """Component -> full type, for ends whose own type the stack has no use for.

    What the node that is `replaced` had counts first; else what the block before publishes, and
    what a robot obeys.
    """
    types: dict[str, str] = {}
    for end in newcomer.ends:
        former = node_ends(replaced) if replaced else ()
        known = _known(other for other in former if other.direction == end.direction)
        known = known or _known(_partners(end, newcomer.section, stack, replaced))
        if known and end.msg_type not in known:
            types[end.component] = known[0]
    return types


def _partners(end: NewEnd, section: str, stack: Stack, replaced: Node | None) -> Iterable[TopicEnd]:
    """The ends that one of the newcomer's cannot do without."""
    hears = end.direction == "subscribes"
    if not hears and section != "control":
        return ()
    sections = BEFORE.get(section, ("control",)) if hears else ("robot",)
    gone = replaced.full_name if replaced else None
    return (
        other
        for other in stack_ends(stack)
        if other.direction != end.direction and other.section in sections and other.owner != gone
    )


def _known(ends: Iterable[TopicEnd]) -> tuple[str, ...]:
    return tuple(end.known_type for end in ends if end.known_type is not None)
