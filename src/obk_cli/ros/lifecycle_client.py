"""Control lifecycle nodes over ROS: find them, query states, request transitions.

The client uses one node of its own and the thread that spins it. Every wait has a limit; errors
from rclpy are converted here.
"""

import os
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from obk_cli.errors import CommandFailedError
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.graph import RosGraph
from obk_cli.ros.participant import (
    RosParticipant,
    make_bare_node,
    open_context,
    remove_participant,
)
from obk_cli.ros.services import ASK_AGAIN_S

__all__ = ["LifecycleClient", "NodeClients", "open_client"]

PING_S: Final = 3.0
"""Limit for the answer to a state query [s]."""
POLL_S: Final = 0.01
END_S: Final = 2.0
"""Limit for running callbacks at shutdown [s]."""
LONGEST_SPIN_S: Final = 3e8
"""Ten years [s]: without a timeout, rclpy's EventsExecutor overflows and runs no callbacks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionReply:
    """A node's reply to a transition request."""

    success: bool
    fault: str
    """The fault that the node reported; empty if there is none."""


class NodeClients:
    """Service clients by node; methods may be called from any thread and return at once."""

    def __init__(self, node: Any) -> None:
        """Start without clients.

        Args:
            node: the rclpy node that sends requests.
        """
        from lifecycle_msgs.srv import ChangeState, GetState
        from std_srvs.srv import Trigger

        self._node = node
        self._types = {"change_state": ChangeState, "get_state": GetState, "last_error": Trigger}
        self._clients: dict[tuple[str, str], Any] = {}
        self._pings: defaultdict[str, deque[tuple[float, Any]]] = defaultdict(deque)
        self._lock = threading.Lock()

    def open(self, node: str) -> None:
        """Create the clients of a node, so that they can discover their services."""
        # In the order in which nodes offer them, which DDS keeps: a node whose `get_state` answers
        # also knows this client's `change_state`.
        for service in self._types:
            self._client(node, service)

    def is_ready(self, node: str, service: str) -> bool:
        """Whether a server exists; one that was killed counts until its lease ends."""
        return bool(self._client(node, service).service_is_ready())

    def ask_state(self, node: str) -> Any:
        """A future for the node's state; dropped with its callbacks if no answer arrives."""
        client = self._client(node, "get_state")
        now = time.monotonic()
        with self._lock:
            pings = self._pings[node]
            while pings and (pings[0][0] < now - PING_S or pings[0][1].done()):
                client.remove_pending_request(pings.popleft()[1])
            future = client.call_async(self._types["get_state"].Request())
            pings.append((now, future))
        return future

    def ask_fault(self, node: str) -> Any:
        """A future for the node's latest fault."""
        return self._client(node, "last_error").call_async(self._types["last_error"].Request())

    def change_state(self, node: str, transition: str) -> Any:
        """A future for the result of the node's transition."""
        request = self._types["change_state"].Request()
        # By name: the ID of `shutdown` depends on the state, and an unknown ID crashes
        # plain rclpy nodes.
        request.transition.label = transition
        return self._client(node, "change_state").call_async(request)

    def _client(self, node: str, service: str) -> Any:
        with self._lock:
            if (node, service) not in self._clients:
                self._clients[node, service] = self._node.create_client(
                    self._types[service], f"{node}/{service}"
                )
            return self._clients[node, service]


class LifecycleClient:
    """Queries lifecycle nodes and waits for their answers."""

    def __init__(
        self, name: str, context: Any, executor: Any, begin_s: float | None = None
    ) -> None:
        """Create the node; it is spun after `__enter__`.

        Args:
            name: name of the node.
            context: initialized rclpy context.
            executor: rclpy executor of that context.
            begin_s: when the context's participant started discovery (monotonic [s]); None: the
                node is its first one.
        """
        self._context = context
        self._executor = executor
        self._nodes: list[Any] = []
        self._node = self.add_node(name)
        self._clients = NodeClients(self._node)
        self._thread = threading.Thread(target=_spin, args=(executor,), name="ros", daemon=True)
        self.graph: Final = RosGraph(self._node, begin_s)
        """Other nodes in the ROS domain."""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown(timeout_sec=END_S)
        self._thread.join(END_S)
        if not self._thread.is_alive():
            for node in self._nodes:
                remove_participant(node.destroy_node)

    def add_node(self, name: str) -> Any:
        """Create another rclpy node, without a namespace, that is spun and destroyed with ours."""
        import rclpy

        node = rclpy.create_node(
            name, context=self._context, start_parameter_services=False, enable_rosout=False
        )
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def participant(self) -> RosParticipant:
        """The graph as seen by our node, for any thread."""
        from rclpy.impl.implementation_singleton import rclpy_implementation

        domain = self._context.get_domain_id()
        return RosParticipant(self._node.handle, rclpy_implementation, domain)

    def find(self, expected: Iterable[str], timeout_s: float, quiet_s: float) -> tuple[str, ...]:
        """Full names of the lifecycle nodes in the graph; see `RosGraph.find`."""
        return self.graph.find(expected, timeout_s, quiet_s)

    def change(self, node: str, transition: str, timeout_s: float) -> TransitionReply | None:
        """Request a transition of a node and wait; None if no answer arrives in time."""
        response = self._wait(self._clients.change_state(node, transition), timeout_s)
        if response is None:
            return None
        fault = "" if response.success else self.last_fault(node, timeout_s)
        return TransitionReply(success=bool(response.success), fault=fault)

    def state(self, node: str, timeout_s: float) -> str | None:
        """A node's state; None if no answer arrives in time."""
        end = time.monotonic() + timeout_s
        self._clients.open(node)
        if not self._wait_until_ready(node, "get_state", timeout_s):
            return None
        response = self._answer(lambda: self._clients.ask_state(node), end - time.monotonic())
        return None if response is None else str(response.current_state.label)

    def last_fault(self, node: str, timeout_s: float) -> str:
        """An Obelisk node's latest fault; empty if it does not answer."""
        if not self._wait_until_ready(node, "last_error", timeout_s):
            return ""
        response = self._answer(lambda: self._clients.ask_fault(node), timeout_s)
        return "" if response is None else str(response.message)

    def _answer(self, ask: Callable[[], Any], timeout_s: float) -> Any:
        """Repeat a query until it is answered; None if no answer arrives in time."""
        end, response = time.monotonic() + timeout_s, None
        while response is None and (left_s := end - time.monotonic()) > 0:
            response = self._wait(ask(), min(ASK_AGAIN_S, left_s))
        return response

    def _wait(self, future: Any, timeout_s: float) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        self._executor.wake()
        return future.result() if done.wait(timeout_s) else None

    def _wait_until_ready(self, node: str, service: str, timeout_s: float) -> bool:
        end = time.monotonic() + timeout_s
        while not self._clients.is_ready(node, service):
            if time.monotonic() > end:
                return False
            time.sleep(POLL_S)
        return True


C = TypeVar("C", bound=LifecycleClient)


@contextmanager
def open_client(name: str, environment: RosEnvironment, kind: type[C]) -> Iterator[C]:
    """Open a client with its own ROS node that spins in a thread.

    Args:
        name: the node's name; the process id is added.
        environment: applied to this process first.
        kind: class of the client.

    Raises:
        CommandFailedError: rclpy is missing, or does not start.
    """
    with open_context(environment) as context, ExitStack() as stack:
        try:
            # The first node of the context creates the participant, which remains for the others.
            # While it discovers other nodes, load the modules that an rclpy node needs.
            first = make_bare_node(context)
            begin_s = time.monotonic()
            client = _make_client(f"{name}_{os.getpid()}", context, begin_s, kind)
            first.destroy_when_not_in_use()
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        stack.enter_context(client)
        yield client


def _make_client(name: str, context: Any, begin_s: float, kind: type[C]) -> C:
    from rclpy.signals import SignalHandlerOptions, install_signal_handlers

    install_signal_handlers(SignalHandlerOptions.NO)
    return kind(name, context, _make_executor(context), begin_s)


def _make_executor(context: Any) -> Any:
    """An executor whose cost does not depend on the number of clients, if rclpy has one."""
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.impl.implementation_singleton import rclpy_implementation

    if not hasattr(rclpy_implementation, "EventsExecutor"):  # rclpy before 7.1.4
        return SingleThreadedExecutor(context=context)
    # `rclpy.experimental.EventsExecutor` does the same, but also enables `faulthandler` on
    # `sys.stderr`, which fails in the terminal applications: it is not a file there.
    executor = rclpy_implementation.EventsExecutor(context)
    context.on_shutdown(executor.wake)
    return executor


def _spin(executor: Any) -> None:
    """Run callbacks until the executor is shut down."""
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.task import Future

    if isinstance(executor, SingleThreadedExecutor):
        # With a future, it would add another callback to it for each one that it runs.
        executor.spin()
    else:
        executor.spin_until_future_complete(Future(), LONGEST_SPIN_S)  # type: ignore[no-untyped-call]
