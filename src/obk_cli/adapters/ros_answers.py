"""Answers to questions about the ROS graph from a node that is there already, the launcher's.

In: a question and what takes the answer, both JSON's values:

- `{"about": "graph"}`: see `looking.told`.
- `{"about": "parameters", "node": NAME, "timeout_s": S, "do": ...}`: `names`; `values` of `names`;
  `kind` of `name`; `set` of `name` to `parameter`.

What cannot be answered is `{"failed": SENTENCE}`. Each question has a thread of its own, so that a
node that hangs holds up nobody.
"""

import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

from obk_cli.adapters.ros_look import RosLook
from obk_cli.adapters.ros_parameters import NodeParameters
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.looking.told import (
    GraphTold,
    NodeEnds,
    emit_graph,
    emit_parameter,
    parse_parameter_told,
)

__all__ = ["RosAnswers"]

LONGEST_S: Final = 60.0
"""How long a node may be waited for [s]."""


class RosAnswers:
    """Tells others what one node knows."""

    def __init__(self, look: RosLook) -> None:
        """Begin.

        Args:
            look: the node's.
        """
        self._look = look

    def ask(
        self, question: Mapping[str, Any], reply: Callable[[Mapping[str, Any]], None]
    ) -> threading.Thread:
        """Answer a question; `reply` is called once, from the thread that is given."""

        def answer() -> None:
            try:
                told = self._answer(question)
            except (CommandFailedError, MisuseError) as error:
                told = {"failed": error.message, "help": error.help}
            except Exception as error:  # of a node that is being brought to its end
                told = {"failed": f"the launcher cannot tell: {error}"}
            reply(told)

        thread = threading.Thread(target=answer, name="look", daemon=True)
        thread.start()
        return thread

    def _answer(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        match question:
            case {"about": "graph"}:
                return emit_graph(self._graph())
            case {"about": "parameters", "node": str(node), "timeout_s": int() | float() as wait_s}:
                parameters = NodeParameters(self._look, node, min(float(wait_s), LONGEST_S))
                return _of_parameters(parameters, question)
        raise CommandFailedError("the launcher does not know such a question")

    def _graph(self) -> GraphTold:
        look = self._look
        nodes = {}
        for node in (*look.nodes(), look.name):
            publishes, subscribes = look.topics_of(node)
            nodes[node] = NodeEnds(
                publishes=publishes, subscribes=subscribes, services=look.services_of(node)
            )
        return GraphTold(graph=look.graph(), nodes=nodes)


def _of_parameters(parameters: NodeParameters, question: Mapping[str, Any]) -> Mapping[str, Any]:
    match question:
        case {"do": "names"}:
            return {"names": parameters.names()}
        case {"do": "values", "names": [*names]}:
            values = parameters.values([str(name) for name in names])
            return {"values": [emit_parameter(value) for value in values.values()]}
        case {"do": "kind", "name": str(name)}:
            return {"kind": parameters.declared_kind(name)}
        case {"do": "set", "name": str(name), "parameter": data}:
            parameter = parse_parameter_told(data)
            if parameter is not None:
                return {"reason": parameters.set(name, parameter)}
    raise CommandFailedError("the launcher does not know such a question")
