"""Life-cycle nodes over ROS: finding them, asking for states and transitions, hearing of faults.

One node of our own and the thread that spins it. Everything waits with a deadline; what rclpy
raises is mapped here.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Final, Self

from obk_cli.adapters.extras import no_ros
from obk_cli.adapters.late_generator import leave_generator_for_later
from obk_cli.adapters.ros_calls import ASK_AGAIN_S
from obk_cli.adapters.ros_clients import NodeClients
from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.adapters.ros_graph import RosGraph
from obk_cli.adapters.ros_look import RosLook
from obk_cli.adapters.ros_rates import listen_to_rates
from obk_cli.adapters.ros_watch import NodeWatch
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Answered, InputEvent, StateAnswered

__all__ = ["RosLifecycle", "open_ros"]

LOOK_S: Final = 0.01
END_S: Final = 2.0
"""How long a callback may still take at the end [s]."""


@contextmanager
def open_ros(name: str, environment: RosEnvironment) -> "Iterator[RosLifecycle]":
    """A ROS node of our own that talks to life-cycle nodes, spinning in a thread.

    Args:
        name: the node's name; the process id is added.
        environment: put into effect for this process first.

    Raises:
        CommandFailedError: there is no rclpy, or it does not start.
    """
    environment.put_into_effect()
    try:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise no_ros(error) from error
    leave_generator_for_later()
    with ExitStack() as stack:
        context = rclpy.Context()
        try:
            context.init(domain_id=environment.domain)
            stack.callback(context.try_shutdown)
            rclpy.signals.install_signal_handlers(SignalHandlerOptions.NO)
            executor = SingleThreadedExecutor(context=context)
            ros = RosLifecycle(f"{name}_{os.getpid()}", context, executor)
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        yield stack.enter_context(ros)


class RosLifecycle:
    """Asks life-cycle nodes; answers come to `hear` or from a future."""

    def __init__(self, name: str, context: Any, executor: Any) -> None:
        """Make the node; it spins from `__enter__` on.

        Args:
            name: of the node.
            context: of rclpy, initialised.
            executor: of rclpy, of that context.
        """
        self._context = context
        self._executor = executor
        self._nodes: list[Any] = []
        self._node = self.add_node(name)
        self._hear: Callable[[InputEvent], None] = lambda _: None
        self._clients = NodeClients(self._node)
        self._watch = NodeWatch(self._node, self._clients, self._pass_on, executor.wake)
        self._thread = threading.Thread(target=executor.spin, name="ros", daemon=True)
        self.graph: Final = RosGraph(self._node)
        """Who else is there."""

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
                node.destroy_node()

    def add_node(self, name: str) -> Any:
        """Another rclpy node, without a namespace, that is spun and ended along with ours."""
        import rclpy

        node = rclpy.create_node(
            name, context=self._context, start_parameter_services=False, enable_rosout=False
        )
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def look(self) -> RosLook:
        """The graph as our node sees it, to be looked at from any thread."""
        from rclpy.impl.implementation_singleton import rclpy_implementation

        domain = self._context.get_domain_id()
        return RosLook(self._node.handle, rclpy_implementation, domain)

    def listen(self, hear: Callable[[InputEvent], None]) -> None:
        """Send what nodes answer and tell to `hear`, from a thread."""
        self._hear = hear

    def listen_to_rates(self, nodes: Iterable[str]) -> None:
        """Hear of the rates of these nodes: `RatesReported` once a second for each that tells."""
        listen_to_rates(self._node, nodes, self._pass_on)

    def watch(self, nodes: Iterable[str]) -> None:
        """Listen for these nodes: `Ready` when their services answer, and what they tell later.

        A node that was watched before runs in a new process; `Ready` follows for that one.
        """
        self._watch.watch(nodes)

    def request(self, node: str, transition: str) -> None:
        """Ask a node for a transition by its name; `Answered` follows unless the node dies."""

        def answer(future: Any) -> None:
            if future.result().success:
                tell(True, "")
            else:
                self._watch.tell_fault(node, lambda fault: tell(False, fault))

        def tell(success: bool, fault: str) -> None:
            self._hear(Answered(node=node, transition=transition, success=success, fault=fault))

        self._clients.change_state(node, transition).add_done_callback(answer)

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows unless the node is gone or hangs."""

        def tell(future: Any) -> None:
            self._hear(StateAnswered(node=node, state=str(future.result().current_state.label)))

        self._clients.ask_state(node).add_done_callback(tell)

    def change(self, node: str, transition: str, timeout_s: float) -> Answered | None:
        """Ask a node for a transition and wait; None when no answer came in time."""
        response = self._wait(self._clients.change_state(node, transition), timeout_s)
        if response is None:
            return None
        fault = "" if response.success else self.last_fault(node, timeout_s)
        return Answered(
            node=node, transition=transition, success=bool(response.success), fault=fault
        )

    def state(self, node: str, timeout_s: float) -> str | None:
        """A node's state; None when no answer came in time."""
        end = time.monotonic() + timeout_s
        self._clients.open(node)
        if not self._wait_until_ready(node, "get_state", timeout_s):
            return None
        response = self._answer(lambda: self._clients.ask_state(node), end - time.monotonic())
        return None if response is None else str(response.current_state.label)

    def last_fault(self, node: str, timeout_s: float) -> str:
        """What an Obelisk node says of its newest fault; empty when it says nothing."""
        if not self._wait_until_ready(node, "last_error", timeout_s):
            return ""
        response = self._answer(lambda: self._clients.ask_fault(node), timeout_s)
        return "" if response is None else str(response.message)

    def find(self, expected: Iterable[str], timeout_s: float, quiet_s: float) -> tuple[str, ...]:
        """Full names of the life-cycle nodes in the graph; see `RosGraph.find`."""
        return self.graph.find(expected, timeout_s, quiet_s)

    def taken(self, names: Iterable[str], discovery_s: float) -> tuple[str, ...]:
        """Those of the full names that other nodes have already; see `RosGraph.taken`."""
        return self.graph.taken(names, discovery_s)

    def foreign_publishers(
        self, topics: Iterable[str], ours: Iterable[str], discovery_s: float
    ) -> tuple[tuple[str, str], ...]:
        """Who else publishes on these topics; see `RosGraph.foreign_publishers`."""
        return self.graph.foreign_publishers(topics, ours, discovery_s)

    def _pass_on(self, heard: InputEvent) -> None:
        self._hear(heard)

    def _answer(self, ask: Callable[[], Any], timeout_s: float) -> Any:
        """What comes on a question, asked again where the answer got lost; None: not in time."""
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
            time.sleep(LOOK_S)
        return True
