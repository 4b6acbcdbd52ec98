"""Find the topic, node or service that a name means in a ROS graph.

A name may be full or the end of one; of a node, also its section. A run's plan helps to find it
early.
"""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final, Literal

from obelisk_spec.suggestions import did_you_mean, list_names, near_names
from obk_cli.errors import CommandFailedError
from obk_cli.ros.graph import TopicInfo
from obk_cli.runs.registry import section_of

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import GraphSource
    from obk_cli.introspect.target import GraphTarget

__all__ = [
    "Kind",
    "absolute",
    "find_node",
    "find_service",
    "find_topic",
    "matching_names",
    "matching_nodes",
    "resolve_one",
    "settle",
    "the_type",
]

Kind = Literal["topic", "node", "service"]


def absolute(name: str) -> str:
    """The name with a slash before it."""
    return name if name.startswith("/") else f"/{name}"


def matching_names(name: str, known: Iterable[str]) -> tuple[str, ...]:
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


def matching_nodes(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known nodes that a name may stand for, or those of the section of that name."""
    every = tuple(known)
    return matching_names(name, every) or tuple(one for one in every if section_of(one) == name)


def resolve_one(kind: Kind, name: str, known: Collection[str], domain: int) -> str:
    """The one full name that is meant.

    Args:
        kind: what it is the name of.
        name: as a user gives it.
        known: full names that are there.
        domain: the ROS domain in which they are.

    Raises:
        CommandFailedError: there is none, or there are several.
    """
    fitting = _matching(kind)(name, known)
    if len(fitting) > 1:
        raise CommandFailedError(
            f"`{name}` is ambiguous", help=f"choose one of {list_names(fitting)}"
        )
    if not fitting:
        raise CommandFailedError(
            f"there is no {kind} `{name}` in the ROS domain {domain}",
            help=_near(name, sorted(known)),
        )
    return fitting[0]


def _matching(kind: Kind) -> Callable[[str, Iterable[str]], tuple[str, ...]]:
    return matching_nodes if kind == "node" else matching_names


def _near(name: str, known: Collection[str]) -> str | None:
    """What may be meant, by whole names or by their last parts; else what there is."""
    tails = {full.rpartition("/")[2].removeprefix("obelisk_"): full for full in known}
    near = [] if name.startswith("/") else [tails[tail] for tail in near_names(name, tails)]
    if near and not near_names(name, known):
        return f"did you mean {' or '.join(f'`{full}`' for full in near)}?"
    return did_you_mean(name, known)


OTHER_NODES_QUIET_S: Final = 1.0
"""Without a change, the graph is complete if no nodes are expected [s]."""
FOREIGN_NODES_S: Final = 3.3
"""Within which also nodes that announce themselves every 3 s have done so [s]."""


def settle(
    source: "GraphSource", target: "GraphTarget", timeout_s: float, *, wait_s: float | None = None
) -> None:
    """Wait until the graph is discovered.

    Args:
        source: the graph.
        target: whose nodes are known to run.
        timeout_s: how long to wait for these, or where there are none for any [s].
        wait_s: since the start, for nodes not started by obk [s].

    Raises:
        CommandFailedError: there is no node at all.
    """
    if wait_s is not None:
        source.rest(wait_s)
    _require_nodes(source, target, timeout_s)
    source.settle(target.nodes, OTHER_NODES_QUIET_S, timeout_s)


def find_topic(
    source: "GraphSource",
    target: "GraphTarget",
    name: str,
    timeout_s: float,
    *,
    is_published: bool = True,
) -> TopicInfo:
    """A topic that some node has.

    Args:
        source: the graph.
        target: where it is looked for.
        name: full, or the end of a name.
        timeout_s: how long to wait for it [s].
        is_published: whether a publisher is waited for.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """

    def is_there(full: str) -> bool:
        return full in source.topic_types() and not (
            is_published and not source.topic(full).publishers
        )

    full = _find(
        source, target, "topic", name, target.topics, is_there, timeout_s, source.topic_types
    )
    return source.topic(full)


def find_node(source: "GraphSource", target: "GraphTarget", name: str, timeout_s: float) -> str:
    """The full name of a node.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        source,
        target,
        "node",
        name,
        target.nodes,
        lambda full: full in source.nodes(),
        timeout_s,
        source.nodes,
    )


def find_service(source: "GraphSource", target: "GraphTarget", name: str, timeout_s: float) -> str:
    """The full name of a service.

    Raises:
        CommandFailedError: there is none of that name, or there are several.
    """
    return _find(
        source,
        target,
        "service",
        name,
        (),
        lambda full: full in source.service_types(),
        timeout_s,
        source.service_types,
    )


def the_type(kind: Kind, name: str, types: Collection[str]) -> str:
    """The one type of a topic or service.

    Raises:
        CommandFailedError: no node has one, or nodes have different ones.
    """
    if len(types) != 1:
        listed = " and ".join(types) or "none"
        raise CommandFailedError(
            f"the {kind} {name} has the types {listed}",
            help="run `obk topic info` to see which nodes; rename one of the topics"
            if kind == "topic"
            else "choose one with `--type`",
        )
    return next(iter(types))


def _find(
    source: "GraphSource",
    target: "GraphTarget",
    kind: Kind,
    name: str,
    planned: Iterable[str],
    is_there: Callable[[str], bool],
    timeout_s: float,
    there: Callable[[], Collection[str]],
) -> str:
    matching = _matching(kind)
    likely = matching(name, planned) or ((name,) if name.startswith("/") else ())
    _require_nodes(source, target, timeout_s)
    if len(likely) != 1:
        settle(source, target, timeout_s)
        likely = matching(name, there())
    if not likely:
        # The nodes that are known to run were waited for; it may be one that is not.
        source.rest(min(target.no_nodes_s, FOREIGN_NODES_S))
        likely = matching(name, there())
    if len(likely) == 1:
        full = likely[0]
        if source.wait_for(lambda: is_there(full) or None, timeout_s):
            return full
    settle(source, target, timeout_s)
    return resolve_one(kind, name, there(), target.domain)


def _require_nodes(source: "GraphSource", target: "GraphTarget", timeout_s: float) -> None:
    def is_any() -> bool | None:
        return bool(source.nodes() or source.topic_types()) or None

    if not source.wait_for(is_any, timeout_s if target.nodes else target.no_nodes_s):
        raise target.no_nodes_error()
