"""Find the topic, node or service that a name means in a ROS graph.

A name may be full or a suffix of a full name; a node may also be given by its section. The plan of
a run helps to find names early.
"""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final, Literal

from obelisk_spec.suggestions import did_you_mean, list_names, near_names
from obk_cli.errors import CommandFailedError
from obk_cli.ros.graph import TopicInfo
from obk_cli.runs.registry import name_ends, section_of

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import GraphSource
    from obk_cli.introspect.target import GraphTarget

__all__ = [
    "absolute",
    "find_node",
    "find_service",
    "find_topic",
    "matching_names",
    "matching_nodes",
    "near_help",
    "resolve_one",
    "settle",
    "the_type",
]

Kind = Literal["topic", "node", "service"]


def absolute(name: str) -> str:
    """The name with a leading slash."""
    return name if name.startswith("/") else f"/{name}"


def matching_names(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known full names that a name may refer to.

    The name itself, otherwise those that end with it: `est` for `/obelisk/dummy/est`, `control_0`
    for `/obelisk_control_0`.
    """
    every = tuple(dict.fromkeys(known))
    if absolute(name) in every:
        return (absolute(name),)
    if name.startswith("/"):
        return ()
    return tuple(one for one in every if one.endswith(name_ends(name)))


def matching_nodes(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """The known nodes that a name may refer to, or those of the section with this name."""
    every = tuple(known)
    return matching_names(name, every) or tuple(one for one in every if section_of(one) == name)


def resolve_one(kind: Kind, name: str, known: Collection[str], domain: int) -> str:
    """The one full name that is meant.

    Args:
        kind: the kind of thing it names.
        name: as given by the user.
        known: existing full names.
        domain: the ROS domain.

    Raises:
        CommandFailedError: no name matches, or several do.
    """
    fitting = _matching(kind)(name, known)
    if len(fitting) > 1:
        raise CommandFailedError(
            f"`{name}` is ambiguous", help=f"choose one of {list_names(fitting)}"
        )
    if not fitting:
        raise CommandFailedError(
            f"no {kind} `{name}` in ROS domain {domain}",
            help=near_help(name, sorted(known)),
        )
    return fitting[0]


def _matching(kind: Kind) -> Callable[[str, Iterable[str]], tuple[str, ...]]:
    return matching_nodes if kind == "node" else matching_names


def near_help(name: str, known: Collection[str]) -> str | None:
    """A hint with similar names, compared whole or by last part; otherwise the existing names."""
    tails = {full.rpartition("/")[2].removeprefix("obelisk_"): full for full in known}
    near = [] if name.startswith("/") else [tails[tail] for tail in near_names(name, tails)]
    if near and not near_names(name, known):
        return f"did you mean {' or '.join(f'`{full}`' for full in near)}?"
    return did_you_mean(name, known)


OTHER_NODES_QUIET_S: Final = 1.0
"""Time without a change after which the graph is complete, if no nodes are expected [s]."""
FOREIGN_NODES_S: Final = 3.3
"""Time to discover nodes that announce themselves every 3 s [s]."""


def settle(
    source: "GraphSource", target: "GraphTarget", timeout_s: float, *, wait_s: float | None = None
) -> None:
    """Wait until the graph is discovered.

    Args:
        source: the graph.
        target: knows which nodes are running.
        timeout_s: limit for these nodes or, if none are known, for any node [s].
        wait_s: minimum wait since the start, for nodes not started by obk [s].

    Raises:
        CommandFailedError: no node was found.
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
    """Find a topic that some node has.

    Args:
        source: the graph.
        target: the ROS domain and its runs.
        name: full name, or a suffix of one.
        timeout_s: limit for finding it [s].
        is_published: whether to wait for a publisher.

    Raises:
        CommandFailedError: no name matches, or several do.
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
    """Find the full name of a node.

    Raises:
        CommandFailedError: no name matches, or several do.
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
    """Find the full name of a service.

    Raises:
        CommandFailedError: no name matches, or several do.
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
    """The only type of a topic or service.

    Raises:
        CommandFailedError: no node has a type for it, or the types differ.
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
        # The known nodes were waited for already; it may belong to another node.
        source.rest(min(target.no_nodes_s, FOREIGN_NODES_S))
        likely = matching(name, there())
    if len(likely) == 1:
        full = likely[0]
        if source.wait_for(lambda: is_there(full) or None, timeout_s):
            return full
        if kind == "node" and full in target.nodes:
            raise CommandFailedError(
                f"{full} belongs to a running stack, but is not in the ROS graph",
                help="it has exited or does not answer; `obk ps` shows its state",
            )
    settle(source, target, timeout_s)
    return resolve_one(kind, name, there(), target.domain)


def _require_nodes(source: "GraphSource", target: "GraphTarget", timeout_s: float) -> None:
    def is_any() -> bool | None:
        return bool(source.nodes() or source.topic_types()) or None

    if not source.wait_for(is_any, timeout_s if target.nodes else target.no_nodes_s):
        raise target.no_nodes_error()
