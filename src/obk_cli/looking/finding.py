"""The topic, node or service that a user names, found in a ROS graph, or said what there is.

What a run's plan tells helps to find it at once; whether it is there only the graph tells.
"""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final

from obk_cli.errors import CommandFailedError
from obk_cli.looking.graph import TopicSeen
from obk_cli.looking.names import Kind, meant, one_meant
from obk_cli.looking.place import Place

if TYPE_CHECKING:
    from obk_cli.looking.sight import Sight

__all__ = ["find_node", "find_service", "find_topic", "settle", "the_type"]

OTHERS_QUIET_S: Final = 1.0
"""In which nothing is told any more, where it is not known who is there [s]."""
STRANGERS_S: Final = 3.3
"""Within which also nodes that announce themselves every 3 s have done so [s]."""


def settle(look: "Sight", place: Place, timeout_s: float, *, wait_s: float | None = None) -> None:
    """Wait until the graph is told of.

    Args:
        look: the graph.
        place: whose nodes are known to run.
        timeout_s: how long to wait for these, or where there are none for any [s].
        wait_s: since the beginning, for nodes that nobody here knows of [s].

    Raises:
        CommandFailedError: there is no node at all.
    """
    if wait_s is not None:
        look.rest(wait_s)
    _require_somebody(look, place, timeout_s)
    look.settle(place.nodes, OTHERS_QUIET_S, timeout_s)


def find_topic(
    look: "Sight", place: Place, name: str, timeout_s: float, *, is_heard: bool = True
) -> TopicSeen:
    """A topic that somebody has.

    Args:
        look: the graph.
        place: where it is looked for.
        name: full, or the end of a name.
        timeout_s: how long to wait for it [s].
        is_heard: whether a publisher is waited for.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """

    def is_there(full: str) -> bool:
        return full in look.topic_types() and not (is_heard and not look.topic(full).publishers)

    full = _find(look, place, "topic", name, place.topics, is_there, timeout_s, look.topic_types)
    return look.topic(full)


def find_node(look: "Sight", place: Place, name: str, timeout_s: float) -> str:
    """The full name of a node.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        look,
        place,
        "node",
        name,
        place.nodes,
        lambda full: full in look.nodes(),
        timeout_s,
        look.nodes,
    )


def find_service(look: "Sight", place: Place, name: str, timeout_s: float) -> str:
    """The full name of a service.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        look,
        place,
        "service",
        name,
        (),
        lambda full: full in look.service_types(),
        timeout_s,
        look.service_types,
    )


def the_type(kind: Kind, name: str, types: Collection[str]) -> str:
    """The one type of a topic or service.

    Raises:
        CommandFailedError: nobody tells one, or nodes do not agree.
    """
    if len(types) != 1:
        told = " and ".join(types) or "none"
        raise CommandFailedError(
            f"the {kind} {name} has the types {told}",
            help="`obk topic info` tells whose; one of them has to give way"
            if kind == "topic"
            else "`--type` names the one that is meant",
        )
    return next(iter(types))


def _find(
    look: "Sight",
    place: Place,
    kind: Kind,
    name: str,
    planned: Iterable[str],
    is_there: Callable[[str], bool],
    timeout_s: float,
    there: Callable[[], Collection[str]],
) -> str:
    likely = meant(name, planned) or ((name,) if name.startswith("/") else ())
    _require_somebody(look, place, timeout_s)
    if len(likely) != 1:
        settle(look, place, timeout_s)
        likely = meant(name, there())
    if not likely:
        # The nodes that are known to run were waited for; it may be one that is not.
        look.rest(min(place.nobody_s, STRANGERS_S))
        likely = meant(name, there())
    if len(likely) == 1:
        full = likely[0]
        if look.wait_for(lambda: is_there(full) or None, timeout_s):
            return full
    settle(look, place, timeout_s)
    return one_meant(kind, name, there(), place.domain)


def _require_somebody(look: "Sight", place: Place, timeout_s: float) -> None:
    def is_anybody() -> bool | None:
        return bool(look.nodes() or look.topic_types()) or None

    if not look.wait_for(is_anybody, timeout_s if place.nodes else place.nobody_s):
        raise place.nobody()
