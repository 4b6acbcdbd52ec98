"""The ROS graph as the launcher of a stack on this host sees it: asked over its control socket.

Used like a `RosLook`, without ROS: an answer takes some ms, and nobody has to be found first.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from obk_cli.adapters.control_client import ask_look, is_askable
from obk_cli.errors import CommandFailedError
from obk_cli.launch.json_values import value_of
from obk_cli.looking.graph import Graph, TopicSeen
from obk_cli.looking.parameters import Parameter
from obk_cli.looking.plain_data import Plain
from obk_cli.looking.told import (
    GraphTold,
    NodeEnds,
    emit_parameter,
    parse_graph,
    parse_parameter_told,
)

if TYPE_CHECKING:
    from obk_cli.looking.delays import Delay
    from obk_cli.looking.rates import Rate

__all__ = ["LauncherLook", "LauncherParameters", "ask_launcher"]

T = TypeVar("T")

LOOK_S: Final = 0.05
"""Between two questions while something is waited for [s]."""
MARGIN_S: Final = 3.0
"""For the way to the launcher and back, beside what a node may take [s]."""
PUBLISH_S: Final = 10.0
"""For a message on its way by the launcher's node, which waits for some seconds at most [s]."""
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

    def fields_of(self, name: str) -> Mapping[str, str]:
        """The names and types of a message's fields, by `pkg/Name` or a full name.

        Raises:
            CommandFailedError: the launcher does not have the type, or gives no answer.
        """
        told = _told(self._folder, {"about": "fields", "type": name}, MARGIN_S, fields=dict)
        return {str(field): str(kind) for field, kind in told["fields"].items()}

    def has_type(self, name: str) -> bool:
        """Whether the launcher has a type of message."""
        try:
            self.fields_of(name)
        except CommandFailedError:
            return False
        return True

    def call(self, service: str, kind: str, request: object, timeout_s: float) -> Plain:
        """The response of a service, which the launcher's node calls; None: the request is long.

        Args:
            service: full name.
            kind: full, `pkg/srv/Name`.
            request: JSON's values, checked against the type.
            timeout_s: for the response [s].

        Raises:
            CommandFailedError: none came in time, or there is no server.
        """
        question = {"about": "call", "service": service, "type": kind, "request": request}
        question["timeout_s"] = timeout_s
        if not is_askable(question):
            return None
        told = _told(self._folder, question, timeout_s + MARGIN_S, response=object)
        response: Plain = told["response"]
        return response

    def publish(self, topic: str, kind: str, message: object, subscribers: int) -> bool | None:
        """Have the launcher's node publish a message.

        Args:
            topic: full name.
            kind: full, `pkg/msg/Name`.
            message: JSON's values, checked against the type.
            subscribers: how many have to hear it.

        Returns:
            Whether all who hear it have confirmed it. None: nothing was sent; the message is long,
            the topic moves a robot, or not so many hear the launcher's node.

        Raises:
            CommandFailedError: the launcher gives no answer.
        """
        question = {"about": "publish", "topic": topic, "type": kind, "message": message}
        question["subscribers"] = subscribers
        if not is_askable(question):
            return None
        confirmed = _told(self._folder, question, PUBLISH_S, confirmed=object)["confirmed"]
        return None if confirmed is None else bool(confirmed)

    def rates(self, topics: Mapping[str, str], duration_s: float) -> "Mapping[str, Rate]":
        """What the launcher's node measures of topics.

        Args:
            topics: full name -> full type.
            duration_s: for how long, at most `LAUNCHER_COUNTS_S` [s].

        Raises:
            CommandFailedError: the launcher gives no answer.
        """
        from obk_cli.looking.rates import Rate

        question = {"about": "rates", "topics": dict(topics), "duration_s": duration_s}
        told = _told(self._folder, question, duration_s + MARGIN_S, rates=dict)["rates"]
        rates = {name: value_of(Rate, told.get(name)) for name in topics}
        return {name: rate for name, rate in rates.items() if rate is not None}

    def delay(
        self, topic: str, kind: str, window: int, duration_s: float
    ) -> "tuple[Delay | None, int]":
        """How late messages came to the launcher's node, and how many had no stamp.

        Args:
            topic: full name.
            kind: full, `pkg/msg/Name`.
            window: messages that the figures go back.
            duration_s: for how long, at most `LAUNCHER_COUNTS_S` [s].

        Raises:
            CommandFailedError: messages of the type have no stamp, or the launcher is silent.
        """
        from obk_cli.looking.delays import Delay

        question = {"about": "delay", "topic": topic, "type": kind, "window": window}
        question["duration_s"] = duration_s
        wait_s = duration_s + MARGIN_S
        told = _told(self._folder, question, wait_s, delay=object, unstamped=int)
        return value_of(Delay, told["delay"]), told["unstamped"]

    def next_message(self, topic: str, kind: str, timeout_s: float) -> Plain:
        """The next message of a topic, which the launcher's node hears; None: it is too long.

        Args:
            topic: full name.
            kind: full, `pkg/msg/Name`.
            timeout_s: for the message [s].

        Raises:
            CommandFailedError: none came in time.
        """
        question = {"about": "message", "topic": topic, "type": kind, "timeout_s": timeout_s}
        told = _told(self._folder, question, timeout_s + MARGIN_S, message=object)
        message: Plain = told["message"]
        return message


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
