"""The ROS graph as the launcher of a stack on this host sees it: asked over its control socket.

Used like a `RosLook`, without ROS: an answer takes some ms, and nobody has to be found first.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from obk_cli.adapters.control_client import ask_look
from obk_cli.errors import CommandFailedError
from obk_cli.looking.graph import Graph, TopicSeen
from obk_cli.looking.parameters import Parameter
from obk_cli.looking.told import (
    GraphTold,
    NodeEnds,
    emit_parameter,
    parse_graph,
    parse_parameter_told,
)

__all__ = ["LauncherLook", "LauncherParameters", "ask_launcher"]

T = TypeVar("T")

LOOK_S: Final = 0.05
"""Between two questions while something is waited for [s]."""
MARGIN_S: Final = 3.0
"""For the way to the launcher and back, beside what a node may take [s]."""
NOTHING: Final = NodeEnds(publishes={}, subscribes={}, services={})


def ask_launcher(folders: Collection[Path]) -> "LauncherLook | None":
    """The graph as the first of these runs' launchers tells it; None: none of them does."""
    for folder in folders:
        told = _graph(folder)
        if told is not None:
            return LauncherLook(folder, told)
    return None


class LauncherLook:
    """The graph by a launcher's word."""

    def __init__(self, folder: Path, told: GraphTold) -> None:
        """Begin with what was told.

        Args:
            folder: the run's.
            told: by its launcher.
        """
        self._folder = folder
        self._told = told

    def nodes(self) -> tuple[str, ...]:
        """Full names of the nodes."""
        return self._told.graph.nodes

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the topics."""
        return {topic.name: topic.msg_types for topic in self._told.graph.topics}

    def service_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the services."""
        return dict(self._told.graph.services)

    def topics_of(self, node: str) -> tuple[Mapping[str, tuple[str, ...]], ...]:
        """Topic -> types of a node's publishers, and of its subscriptions."""
        ends = self._told.nodes.get(node, NOTHING)
        return ends.publishes, ends.subscribes

    def services_of(self, node: str) -> Mapping[str, tuple[str, ...]]:
        """Full name -> types of a node's services."""
        return self._told.nodes.get(node, NOTHING).services

    def topic(self, name: str) -> TopicSeen:
        """A topic with its ends."""
        return self._told.graph.topic(name)

    def graph(self) -> Graph:
        """All that was told."""
        return self._told.graph

    def settle(self, expected: Collection[str], _quiet_s: float, timeout_s: float) -> bool:
        """Wait until the expected nodes are there; see `RosLook.settle`."""
        wanted = frozenset(expected)
        return bool(self.wait_for(lambda: wanted <= set(self.nodes()) or None, timeout_s))

    def rest(self, seconds: float) -> None:
        """Return at once: the launcher was told of others long ago."""

    def wait_for(self, probe: Callable[[], T | None], timeout_s: float) -> T | None:
        """What a probe finds, asked again and again; None: nothing in time."""
        end = time.monotonic() + timeout_s
        while (found := probe()) is None and time.monotonic() < end:
            time.sleep(LOOK_S)
            self._told = _graph(self._folder) or self._told
        return found

    def parameters(self, node: str, timeout_s: float) -> "LauncherParameters":
        """The parameters of a node; each answer has this deadline [s]."""
        return LauncherParameters(self._folder, node, timeout_s)


class LauncherParameters:
    """The parameters of one node, asked for by its launcher; used like `NodeParameters`."""

    def __init__(self, folder: Path, node: str, timeout_s: float) -> None:
        """Ask nothing yet.

        Args:
            folder: the run's.
            node: full name.
            timeout_s: for each answer [s].
        """
        self._folder = folder
        self._question = {"about": "parameters", "node": node, "timeout_s": timeout_s}
        self._wait_s = timeout_s + MARGIN_S

    def names(self) -> tuple[str, ...]:
        """The names of all.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        return tuple(map(str, self._ask("names", list, do="names")))

    def values(self, names: Sequence[str]) -> Mapping[str, Parameter]:
        """The values of these; `not set` where the node has none of that name.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        told = self._ask("values", list, do="values", names=list(names))
        if len(told) != len(names):
            raise _otherwise("values")
        found = {name: parse_parameter_told(one) for name, one in zip(names, told, strict=True)}
        return {name: one for name, one in found.items() if one is not None}

    def declared_kind(self, name: str) -> str:
        """The type that a parameter is declared with, also where it has no value.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        return str(self._ask("kind", str, do="kind", name=name))

    def set(self, name: str, parameter: Parameter) -> str | None:
        """Set one; gives the node's reason where it refuses.

        Raises:
            CommandFailedError: the node gives no answer.
        """
        told = emit_parameter(parameter)
        reason = self._ask("reason", object, do="set", name=name, parameter=told)
        return None if reason is None else str(reason)

    def _ask(self, key: str, kind: type, **more: Any) -> Any:
        question = {**self._question, **more}
        return _told(self._folder, question, self._wait_s, **{key: kind})[key]


def _told(
    folder: Path, question: Mapping[str, Any], wait_s: float, **kinds: type
) -> Mapping[str, Any]:
    told = ask_look(folder, question, wait_s)
    if told is None:
        raise CommandFailedError("the launcher of the stack gave no answer", help="see `obk ps`")
    if "failed" in told:
        raise CommandFailedError(str(told["failed"]), help=told.get("help"))
    for key, kind in kinds.items():
        if key not in told or not isinstance(told[key], kind):
            raise _otherwise(key, is_there=key in told)
    return told


def _otherwise(key: str, *, is_there: bool = True) -> CommandFailedError:
    how = f"with `{key}` in another form" if is_there else f"without `{key}`"
    return CommandFailedError(
        f"the launcher of the stack answers {how}",
        help="is it of another version? Stop the stack, and launch it by this one",
    )


def _graph(folder: Path) -> GraphTold | None:
    told = ask_look(folder, {"about": "graph"})
    return None if told is None else parse_graph(told)
