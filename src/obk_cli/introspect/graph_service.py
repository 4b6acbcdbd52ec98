"""Answers other terminals' questions about the ROS graph from the launcher's node.

Questions and replies are JSON, see `introspect.protocol`. Each question has a thread of its own, so
that a node that hangs delays no other question.
"""

import threading
from collections.abc import Callable
from typing import Final, cast

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.protocol import (
    FailedReply,
    GraphKnown,
    GraphQuestion,
    GraphReply,
    KindReply,
    NamesReply,
    NodeEnds,
    ParameterQuestion,
    Question,
    ReasonReply,
    ValuesReply,
    graph_reply,
    parameter_of,
    wire_parameter,
)
from obk_cli.ros.parameters import NodeParameters
from obk_cli.ros.participant import RosLook
from obk_cli.runs.protocol import decode, encode

__all__ = ["GraphService"]

LONGEST_S: Final = 60.0
"""How long a node may take to answer [s]."""

Reply = GraphReply | NamesReply | ValuesReply | KindReply | ReasonReply | FailedReply


class GraphService:
    """Answers with what one node knows."""

    def __init__(self, look: RosLook) -> None:
        """Serve questions.

        Args:
            look: the node's.
        """
        self._look = look

    def ask(self, question: bytes, reply: Callable[[bytes], None]) -> threading.Thread:
        """Answer a question; `reply` is called once, from the thread that is returned."""

        def answer() -> None:
            result: Reply
            try:
                result = self._answer(question)
            except (CommandFailedError, MisuseError) as error:
                result = FailedReply(failed=error.message, help=error.help)
            except Exception as error:  # of a node that is being shut down
                result = FailedReply(failed=f"the launcher cannot answer: {error}")
            reply(encode(result))

        thread = threading.Thread(target=answer, name="look", daemon=True)
        thread.start()
        return thread

    def _answer(self, question: bytes) -> Reply:
        try:
            asked = cast(Question, decode(question, Question))
        except ValueError as error:
            raise CommandFailedError(f"invalid question: {error}") from error
        if isinstance(asked, GraphQuestion):
            return graph_reply(self._graph())
        wait_s = min(asked.timeout_s, LONGEST_S)
        return _of_parameters(NodeParameters(self._look, asked.node, wait_s), asked)

    def _graph(self) -> GraphKnown:
        look = self._look
        nodes = {}
        for node in (*look.nodes(), look.name):
            publishes, subscribes = look.topics_of(node)
            nodes[node] = NodeEnds(
                publishes=publishes, subscribes=subscribes, services=look.services_of(node)
            )
        return GraphKnown(graph=look.graph(), nodes=nodes)


def _of_parameters(parameters: NodeParameters, asked: ParameterQuestion) -> Reply:
    match asked.do:
        case "names":
            return NamesReply(names=parameters.names())
        case "values":
            values = parameters.values(asked.names).values()
            return ValuesReply(values=tuple(map(wire_parameter, values)))
        case "kind":
            return KindReply(kind=parameters.declared_kind(asked.name))
        case "set":
            if asked.parameter is None:
                raise CommandFailedError("invalid question: it has no `parameter`")
            return ReasonReply(reason=parameters.set(asked.name, parameter_of(asked.parameter)))
