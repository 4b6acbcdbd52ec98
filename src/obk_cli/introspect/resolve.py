"""Find the topic, node or service that a name means in a ROS graph.

A name may be full or the end of one. A run's plan helps to find it early.
"""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final, Literal

from obelisk_spec.suggestions import did_you_mean, list_names, near_names
from obk_cli.errors import CommandFailedError
from obk_cli.ros.graph import TopicSeen

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import GraphSource
    from obk_cli.introspect.target import GraphTarget

__all__ = [
    "Kind",
    "absolute",
    "find_node",
    "find_service",
    "find_topic",
    "meant",
    "one_meant",
    "settle",
    "the_type",
]

Kind = Literal["topic", "node", "service"]


def absolute(name: str) -> str:
    """The name with a slash before it."""
    return name if name.startswith("/") else f"/{name}"


def meant(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known full names that a name may stand for.

    The very one, else those that end in it: `est` for `/obelisk/dummy/est`, `control_0` for
    `/obelisk_control_0`.
    """
    every = tuple(dict.fromkeys(known))
    if absolute(name) in every:
        return (absolute(name),)
    if name.startswith("/"):
        return ()
    return tuple(one for one in every if one.endswith((f"/{name}", f"/obelisk_{name}")))


def one_meant(kind: Kind, name: str, known: Collection[str], domain: int) -> str:
    """The one full name that is meant.

    Args:
        kind: what it is the name of.
        name: as a user gives it.
        known: full names that are there.
        domain: the ROS domain in which they are.

    Raises:
        CommandFailedError: there is none, or there are several.
    """
    fitting = meant(name, known)
    if len(fitting) > 1:
        raise CommandFailedError(
            f"`{name}` means several {kind}s", help=f"name one of {list_names(fitting)}"
        )
    if not fitting:
        raise CommandFailedError(
            f"there is no {kind} `{name}` in the ROS domain {domain}",
            help=_near(name, sorted(known)),
        )
    return fitting[0]


def _near(name: str, known: Collection[str]) -> str | None:
    """What may be meant, by whole names or by their last parts; else what there is."""
    tails = {full.rpartition("/")[2].removeprefix("obelisk_"): full for full in known}
    near = [] if name.startswith("/") else [tails[tail] for tail in near_names(name, tails)]
    if near and not near_names(name, known):
        return f"did you mean {' or '.join(f'`{full}`' for full in near)}?"
    return did_you_mean(name, known)


OTHERS_QUIET_S: Final = 1.0
"""In which nothing is told any more, where it is not known who is there [s]."""
STRANGERS_S: Final = 3.3
"""Within which also nodes that announce themselves every 3 s have done so [s]."""


def settle(
    look: "GraphSource", target: "GraphTarget", timeout_s: float, *, wait_s: float | None = None
) -> None:
    """Wait until the graph is told of.

    Args:
        look: the graph.
        target: whose nodes are known to run.
        timeout_s: how long to wait for these, or where there are none for any [s].
        wait_s: since the beginning, for nodes that nobody here knows of [s].

    Raises:
        CommandFailedError: there is no node at all.
    """
    if wait_s is not None:
        look.rest(wait_s)
    _require_somebody(look, target, timeout_s)
    look.settle(target.nodes, OTHERS_QUIET_S, timeout_s)


def find_topic(
    look: "GraphSource",
    target: "GraphTarget",
    name: str,
    timeout_s: float,
    *,
    is_heard: bool = True,
) -> TopicSeen:
    """A topic that somebody has.

    Args:
        look: the graph.
        target: where it is looked for.
        name: full, or the end of a name.
        timeout_s: how long to wait for it [s].
        is_heard: whether a publisher is waited for.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """

    def is_there(full: str) -> bool:
        return full in look.topic_types() and not (is_heard and not look.topic(full).publishers)

    full = _find(look, target, "topic", name, target.topics, is_there, timeout_s, look.topic_types)
    return look.topic(full)


def find_node(look: "GraphSource", target: "GraphTarget", name: str, timeout_s: float) -> str:
    """The full name of a node.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        look,
        target,
        "node",
        name,
        target.nodes,
        lambda full: full in look.nodes(),
        timeout_s,
        look.nodes,
    )


def find_service(look: "GraphSource", target: "GraphTarget", name: str, timeout_s: float) -> str:
    """The full name of a service.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        look,
        target,
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
    look: "GraphSource",
    target: "GraphTarget",
    kind: Kind,
    name: str,
    planned: Iterable[str],
    is_there: Callable[[str], bool],
    timeout_s: float,
    there: Callable[[], Collection[str]],
) -> str:
    likely = meant(name, planned) or ((name,) if name.startswith("/") else ())
    _require_somebody(look, target, timeout_s)
    if len(likely) != 1:
        settle(look, target, timeout_s)
        likely = meant(name, there())
    if not likely:
        # The nodes that are known to run were waited for; it may be one that is not.
        look.rest(min(target.nobody_s, STRANGERS_S))
        likely = meant(name, there())
    if len(likely) == 1:
        full = likely[0]
        if look.wait_for(lambda: is_there(full) or None, timeout_s):
            return full
    settle(look, target, timeout_s)
    return one_meant(kind, name, there(), target.domain)


def _require_somebody(look: "GraphSource", target: "GraphTarget", timeout_s: float) -> None:
    def is_anybody() -> bool | None:
        return bool(look.nodes() or look.topic_types()) or None

    if not look.wait_for(is_anybody, timeout_s if target.nodes else target.nobody_s):
        raise target.nobody()
