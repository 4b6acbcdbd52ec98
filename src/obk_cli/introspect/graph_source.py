"""Read a ROS graph from the launcher of a stack on this host, otherwise with a participant.

The launcher knows the whole graph and answers within milliseconds; a participant has to load ROS
and discover all nodes first.
"""

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, Union, cast

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.protocol import (
    DescriptionsReply,
    FailedReply,
    GraphQuestion,
    GraphReply,
    KnownGraph,
    NamesReply,
    NodeEndpoints,
    ParameterQuestion,
    Question,
    SetReply,
    ValuesReply,
    decode_reply,
    description_of,
    graph_of,
    graph_reply,
    parameter_of,
    wire_description,
    wire_parameter,
)
from obk_cli.introspect.resolve import matching_names
from obk_cli.introspect.target import GraphTarget
from obk_cli.ros.graph import GraphSnapshot, TopicInfo
from obk_cli.ros.parameters import (
    NodeParameter,
    NodeParameters,
    ParameterDescription,
    SetAnswer,
)
from obk_cli.ros.participant import RosParticipant
from obk_cli.runs.protocol import ANSWER_S, Fault, ask_graph, decode, encode

__all__ = [
    "GraphService",
    "GraphSource",
    "LauncherGraph",
    "LauncherParameters",
    "Parameters",
    "ask_launcher",
    "open_graph",
    "parameters_of",
]

if TYPE_CHECKING:
    from obk_cli.ros.parameters import NodeParameters
    from obk_cli.ros.participant import RosParticipant


T = TypeVar("T")

POLL_S: Final = 0.05
"""Polling period of a wait [s]."""
MARGIN_S: Final = 3.0
"""Time for communication with the launcher, in addition to the node's own limit [s]."""
NOTHING: Final = NodeEndpoints(publishes={}, subscribes={}, services={})


def ask_launcher(folders: Collection[Path]) -> "LauncherGraph | None":
    """The graph reported by the first launcher of these runs that answers; None if none does."""
    for folder in folders:
        known = _graph(folder)
        if known is not None:
            return LauncherGraph(folder, known)
    return None


class LauncherGraph:
    """The graph as reported by a launcher."""

    def __init__(self, folder: Path, known: KnownGraph) -> None:
        """Start with what the launcher currently knows.

        Args:
            folder: the folder of the run.
            known: the graph that its launcher knows.
        """
        self._folder = folder
        self._known = known

    def nodes(self) -> tuple[str, ...]:
        """Full names of the nodes."""
        return self._known.graph.nodes

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the topics."""
        return {topic.name: topic.msg_types for topic in self._known.graph.topics}

    def service_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the services."""
        return dict(self._known.graph.services)

    def topics_of(self, node: str) -> tuple[Mapping[str, tuple[str, ...]], ...]:
        """Topic -> types of a node's publishers, and of its subscriptions."""
        endpoints = self._known.nodes.get(node, NOTHING)
        return endpoints.publishes, endpoints.subscribes

    def services_of(self, node: str) -> Mapping[str, tuple[str, ...]]:
        """Full name -> types of a node's services."""
        return self._known.nodes.get(node, NOTHING).services

    def topic(self, name: str) -> TopicInfo:
        """A topic with its publishers and subscriptions."""
        return self._known.graph.topic(name)

    def graph(self) -> GraphSnapshot:
        """The whole graph."""
        return self._known.graph

    def settle(self, expected: Collection[str], _quiet_s: float, timeout_s: float) -> bool:
        """Wait until the expected nodes exist; see `RosParticipant.settle`."""
        required = frozenset(expected)
        return bool(self.wait_for(lambda: required <= set(self.nodes()) or None, timeout_s))

    def rest(self, seconds: float) -> None:
        """Return at once, because the launcher has already discovered the other nodes."""

    def wait_for(self, probe: Callable[[], T | None], timeout_s: float) -> T | None:
        """Poll a probe until it returns a result; None if it returns none in time."""
        end = time.monotonic() + timeout_s
        while (found := probe()) is None and time.monotonic() < end:
            time.sleep(POLL_S)
            self._known = _graph(self._folder) or self._known
        return found

    def parameters(self, node: str, timeout_s: float) -> "LauncherParameters":
        """The parameters of a node, with this time limit for each answer [s]."""
        return LauncherParameters(self._folder, node, timeout_s)


class LauncherParameters:
    """The parameters of one node, read by its launcher; same interface as `NodeParameters`."""

    def __init__(self, folder: Path, node: str, timeout_s: float) -> None:
        """Prepare; queries follow on demand.

        Args:
            folder: the folder of the run.
            node: full name.
            timeout_s: limit for each answer [s].
        """
        self._folder = folder
        self._node = node
        self._timeout_s = timeout_s

    def names(self) -> tuple[str, ...]:
        """The names of all parameters.

        Raises:
            CommandFailedError: the node does not answer.
        """
        return self._ask(NamesReply, do="names").names

    def values(self, names: Sequence[str]) -> Mapping[str, NodeParameter]:
        """The values of these parameters; `not set` if the node does not have one.

        Raises:
            CommandFailedError: the node does not answer.
        """
        values = self._ask(ValuesReply, do="values", names=tuple(names)).values
        if len(values) != len(names):
            raise CommandFailedError(
                f"the launcher of the stack returned {len(values)} values, expected {len(names)}"
            )
        return {name: parameter_of(one) for name, one in zip(names, values, strict=True)}

    def describe(self, names: Sequence[str]) -> Mapping[str, ParameterDescription]:
        """Descriptions of these parameters; names that the node does not have are omitted.

        Raises:
            CommandFailedError: the node does not answer.
        """
        found = self._ask(DescriptionsReply, do="describe", names=tuple(names)).descriptions
        return {one.name: description_of(one) for one in found}

    def set(self, name: str, parameter: NodeParameter) -> SetAnswer:
        """Set a parameter.

        Raises:
            CommandFailedError: the node does not answer.
        """
        wire = wire_parameter(parameter)
        reply = self._ask(SetReply, do="set", name=name, parameter=wire)
        return SetAnswer(successful=reply.successful, reason=reply.reason)

    def _ask(self, kind: type[T], **words: Any) -> T:
        question = ParameterQuestion(node=self._node, timeout_s=self._timeout_s, **words)
        return _ask(self._folder, question, kind, self._timeout_s + MARGIN_S)


def _ask(folder: Path, question: Question, kind: type[T], wait_s: float) -> T:
    """The launcher's reply to a query.

    Raises:
        CommandFailedError: it does not reply, or reports a failure.
    """
    answer = ask_graph(folder, encode(question), wait_s)
    if answer is None:
        raise CommandFailedError(
            "the launcher of the stack did not answer", help="check it with `obk ps`"
        )
    if isinstance(answer, Fault):
        raise CommandFailedError(f"the launcher of the stack: {answer.error}")
    return decode_reply(answer, kind)


def _graph(folder: Path) -> KnownGraph | None:
    try:
        return graph_of(_ask(folder, GraphQuestion(), GraphReply, ANSWER_S))
    except CommandFailedError:
        return None


GraphSource = Union[LauncherGraph, "RosParticipant"]
"""A graph to observe."""
Parameters = Union[LauncherParameters, "NodeParameters"]
"""The parameters of one node."""


@contextmanager
def open_graph(
    target: GraphTarget, node: str | None = None, *, asks_nodes: bool = False
) -> Iterator[GraphSource]:
    """Open the graph of a target.

    Args:
        target: the ROS domain and its runs.
        node: as a user names it; a launcher answers only for nodes of its stack. None: no node.
        asks_nodes: whether parameters of nodes will be queried.

    Raises:
        CommandFailedError: no launcher answers, and rclpy is missing or does not start.
    """
    is_ours = node is None or len(matching_names(node, target.nodes)) == 1
    launcher_graph = ask_launcher(target.runs) if is_ours else None
    if launcher_graph is not None:
        yield launcher_graph
        return

    from obk_cli.ros.parameters import MODULES
    from obk_cli.ros.participant import open_participant

    with open_participant(target.environment, MODULES if asks_nodes else ()) as source:
        yield source


def parameters_of(source: GraphSource, node: str, timeout_s: float) -> Parameters:
    """Open the parameters of a node.

    Args:
        source: the graph in which the node was found.
        node: full name.
        timeout_s: limit for each answer [s].
    """
    if isinstance(source, LauncherGraph):
        return source.parameters(node, timeout_s)

    from obk_cli.ros.parameters import NodeParameters

    return NodeParameters(source, node, timeout_s)


LONGEST_S: Final = 60.0
"""Maximum time limit for a node's answer [s]."""

Reply = GraphReply | NamesReply | ValuesReply | DescriptionsReply | SetReply | FailedReply


class GraphService:
    """Answers queries about the graph and parameters, as seen by one node."""

    def __init__(self, participant: RosParticipant) -> None:
        """Serve queries.

        Args:
            participant: the participant of the node.
        """
        self._participant = participant

    def ask(self, question: bytes, reply: Callable[[bytes], None]) -> threading.Thread:
        """Answer a query; `reply` is called once, from the returned thread."""

        def answer() -> None:
            result: Reply
            try:
                result = self._answer(question)
            except (CommandFailedError, MisuseError) as error:
                result = FailedReply(failed=error.message, help=error.help)
            except Exception as error:  # the node may be shutting down
                result = FailedReply(failed=f"the launcher cannot answer: {error}")
            reply(encode(result))

        thread = threading.Thread(target=answer, name="look", daemon=True)
        thread.start()
        return thread

    def _answer(self, question: bytes) -> Reply:
        try:
            query = cast(Question, decode(question, Question))
        except ValueError as error:
            raise CommandFailedError(f"invalid request: {error}") from error
        if isinstance(query, GraphQuestion):
            return graph_reply(self._graph())
        wait_s = min(query.timeout_s, LONGEST_S)
        return _of_parameters(NodeParameters(self._participant, query.node, wait_s), query)

    def _graph(self) -> KnownGraph:
        participant = self._participant
        nodes = {}
        for node in (*participant.nodes(), participant.name):
            publishes, subscribes = participant.topics_of(node)
            nodes[node] = NodeEndpoints(
                publishes=publishes, subscribes=subscribes, services=participant.services_of(node)
            )
        return KnownGraph(graph=participant.graph(), nodes=nodes)


def _of_parameters(parameters: NodeParameters, query: ParameterQuestion) -> Reply:
    match query.do:
        case "names":
            return NamesReply(names=parameters.names())
        case "values":
            values = parameters.values(query.names).values()
            return ValuesReply(values=tuple(map(wire_parameter, values)))
        case "describe":
            found = parameters.describe(query.names)
            return DescriptionsReply(
                descriptions=tuple(wire_description(name, one) for name, one in found.items())
            )
        case "set":
            if query.parameter is None:
                raise CommandFailedError("invalid request: it has no `parameter`")
            answer = parameters.set(query.name, parameter_of(query.parameter))
            return SetReply(successful=answer.successful, reason=answer.reason)
