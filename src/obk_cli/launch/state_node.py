"""The stack as one lifecycle node in the ROS graph, such as `/dummy`, for any ROS 2 client.

Its services turn requests into `ChangeRequested` and answers into responses; `show` sets its state.
It rejects only requests that the current state does not allow, and changes nothing itself.
"""

import re
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final

from obelisk_spec.names import node_name_fault
from obk_cli.launch.events import ChangeRequested, InputEvent
from obk_cli.launch.transitions import (
    EDGES,
    STATES,
    UNKNOWN,
    Edge,
    edge_between,
    edges_from,
    find_edge,
)
from obk_cli.ros.lifecycle_client import LifecycleClient
from obk_cli.runs.protocol import ChangeAnswer

__all__ = ["StateNode", "rejection", "state_node_name"]

DEPTH: Final = 10


def state_node_name(config_name: str) -> str:
    """Turn a config's name into a valid node name: `my stack` -> `my_stack`, `2d` -> `_2d`."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", config_name)[:200] or "_"
    return name if node_name_fault(name) is None else f"_{name}"


def rejection(state: str, label: str, number: int) -> str:
    """Why a state does not allow a request."""
    possible = ", ".join(edge.label for edge in edges_from(state))
    if not possible:
        when = "has come up" if state == UNKNOWN else f"has finished `{state}`"
        possible = "none" if state == "finalized" else f"none before the stack {when}"
    return (
        f"the transition `{label or number}` is not allowed in the state `{state}`; "
        f"possible now: {possible}"
    )


class StateNode:
    """Hosts the services of a lifecycle node, through which ROS 2 clients control the stack."""

    def __init__(
        self,
        ros: LifecycleClient,
        name: str,
        on_request: Callable[[InputEvent], None],
        log: Callable[[str], None] | None = None,
    ) -> None:
        """Create the node; it is destroyed with `ros`.

        Args:
            ros: spins the node.
            name: name of the stack; see `state_node_name`.
            on_request: receives `ChangeRequested`; the response is sent when that is answered.
            log: receives a line on each rejected request; None: the node's own log.
        """
        from lifecycle_msgs.msg import TransitionEvent

        self._node = ros.add_node(state_node_name(name))
        self._on_request = on_request
        self._log = log or self._node.get_logger().warning
        self._state = UNKNOWN
        self._why = ""
        self._lock = threading.Lock()
        self._events = self._node.create_publisher(TransitionEvent, "~/transition_event", DEPTH)
        self._serve()

    def show(self, state: str) -> None:
        """Show this state of the stack from now on; may be called from any thread."""
        with self._lock:
            start, self._state = self._state, state
        if start != state:
            self._events.publish(_event(start, state))

    def _serve(self) -> None:
        from lifecycle_msgs.srv import (
            ChangeState,
            GetAvailableStates,
            GetAvailableTransitions,
            GetState,
        )
        from std_srvs.srv import Trigger

        create = self._node.create_service
        # The same order as in rclpy and rclcpp: see `NodeClients.open`.
        change = create(ChangeState, "~/change_state", self._on_change)
        _answer_later(change, _change_response)
        create(GetState, "~/get_state", self._on_state)
        create(GetAvailableStates, "~/get_available_states", self._on_states)
        create(GetAvailableTransitions, "~/get_available_transitions", self._on_possible)
        create(GetAvailableTransitions, "~/get_transition_graph", self._on_graph)
        create(Trigger, "~/last_error", self._on_last_error)

    def _on_change(self, request: Any, _response: Any) -> "Future[ChangeAnswer]":
        label, number = str(request.transition.label), int(request.transition.id)
        answered: Future[ChangeAnswer] = Future()
        edge = find_edge(self._state, label, number)
        if edge is None:
            why = rejection(self._state, label, number)
            self._log(why)
            self._answer(answered, ChangeAnswer(success=False, why=why))
        else:
            self._on_request(
                ChangeRequested(transition=edge.label, reply=lambda a: self._answer(answered, a))
            )
        return answered

    def _answer(self, answered: "Future[ChangeAnswer]", answer: ChangeAnswer) -> None:
        self._why = "" if answer.success else answer.why
        answered.set_result(answer)

    def _on_state(self, _request: Any, response: Any) -> Any:
        state = self._state
        response.current_state = _state(state)
        return response

    def _on_states(self, _request: Any, response: Any) -> Any:
        response.available_states = [_state(label) for label in STATES]
        return response

    def _on_possible(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _descriptions(edges_from(self._state))
        return response

    def _on_graph(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _descriptions(EDGES)
        return response

    def _on_last_error(self, _request: Any, response: Any) -> Any:
        response.success, response.message = bool(self._why), self._why
        return response


def _answer_later(service: Any, make_response: Callable[[ChangeAnswer], Any]) -> None:
    """Let a service's callback return a `Future`; the response is sent once that is done.

    A callback that awaits would keep rclpy's executors busy until it is done, and block the node's
    other services.
    """
    send = service.send_response

    def send_later(future: "Future[ChangeAnswer]", header: Any) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        def respond(done: "Future[ChangeAnswer]") -> None:
            # The client may be gone by now; at shutdown, so is the node.
            with suppress(rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError):
                send(make_response(done.result()), header)

        future.add_done_callback(respond)

    service.send_response = send_later


def _change_response(answer: ChangeAnswer) -> Any:
    from lifecycle_msgs.srv import ChangeState

    return ChangeState.Response(success=answer.success)


def _state(label: str) -> Any:
    from lifecycle_msgs.msg import State

    return State(id=STATES.get(label, STATES[UNKNOWN]), label=label)


def _transition(edge: Edge | None) -> Any:
    from lifecycle_msgs.msg import Transition

    return Transition() if edge is None else Transition(id=edge.number, label=edge.label)


def _descriptions(edges: Iterable[Edge]) -> list[Any]:
    from lifecycle_msgs.msg import TransitionDescription

    return [
        TransitionDescription(
            transition=_transition(edge),
            start_state=_state(edge.start),
            goal_state=_state(edge.goal),
        )
        for edge in edges
    ]


def _event(start: str, goal: str) -> Any:
    from lifecycle_msgs.msg import TransitionEvent

    return TransitionEvent(
        transition=_transition(edge_between(start, goal)),
        start_state=_state(start),
        goal_state=_state(goal),
    )
