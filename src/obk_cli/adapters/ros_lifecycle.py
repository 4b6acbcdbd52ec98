"""Life-cycle nodes over ROS: finding them, asking for states and transitions, hearing of faults.

Everything waits with a deadline; what rclpy raises is mapped here.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from types import TracebackType
from typing import Any, Final, Self

from obk_cli.adapters.ros_environment import RosEnvironment
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Answered, Failed, Heard, Ready, StateAnswered, StateSeen
from obk_cli.launch.transitions import RESTING

__all__ = ["RosLifecycle", "failed_transition", "open_ros"]

GET_STATE: Final = "lifecycle_msgs/srv/GetState"
IN_TRANSITION: Final = {
    "configuring": "configure",
    "activating": "activate",
    "deactivating": "deactivate",
    "cleaningup": "cleanup",
    "shuttingdown": "shutdown",
}
"""State that a transition passes through -> transition."""
POLL_S: Final = 0.01
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
    os.environ.update(environment.variables)
    try:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise CommandFailedError(
            f"ROS 2 is not here: {error}",
            help="install obk with its `ros` extra, or source a ROS 2 setup file",
        ) from error
    with ExitStack() as stack:
        context = rclpy.Context()
        try:
            context.init(domain_id=environment.domain)
            stack.callback(context.try_shutdown)
            rclpy.signals.install_signal_handlers(SignalHandlerOptions.NO)
            node: Any = rclpy.create_node(
                f"{name}_{os.getpid()}",
                context=context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        yield stack.enter_context(RosLifecycle(node, executor))


def failed_transition(passed: str, fault: str) -> str:
    """The transition that a fault belongs to; empty when the node failed by itself.

    A node that fails by itself goes to error processing through `deactivate` or `cleanup`; then its
    fault names a callback of another name.

    Args:
        passed: the transition through which the node came to error processing.
        fault: the node's own words, empty where it has none.
    """
    may_be_own = passed in ("deactivate", "cleanup") and fault != ""
    return "" if may_be_own and not fault.startswith(f"on_{passed}:") else passed


class RosLifecycle:
    """Asks life-cycle nodes; answers come to `hear` or from a future."""

    def __init__(self, node: Any, executor: Any) -> None:
        from lifecycle_msgs.srv import ChangeState, GetState
        from std_srvs.srv import Trigger

        self._node = node
        self._executor = executor
        self._types = {"change_state": ChangeState, "get_state": GetState, "last_error": Trigger}
        self._clients: dict[tuple[str, str], Any] = {}
        self._lock = threading.Lock()
        self._hear: Callable[[Heard], None] = lambda _: None
        self._thread = threading.Thread(target=executor.spin, name="ros", daemon=True)
        self._begin = time.monotonic()

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
            self._node.destroy_node()

    def listen(self, hear: Callable[[Heard], None]) -> None:
        """Send `Ready`, answers, `StateSeen` and `Failed` to `hear`, from a thread."""
        self._hear = hear

    def watch(self, nodes: Iterable[str]) -> None:
        """Listen for these nodes: `Ready` when their services answer, and what they tell later."""
        from lifecycle_msgs.msg import TransitionEvent

        waiting = set(nodes)
        if not waiting:
            return
        for name in sorted(waiting):
            self._node.create_subscription(
                TransitionEvent,
                f"{name}/transition_event",
                partial(self._on_transition_event, name),
                10,
            )

        def look() -> None:
            for name in sorted(waiting):
                if self._client(name, "change_state").service_is_ready():
                    waiting.discard(name)
                    self._hear(Ready(node=name))
            if not waiting:
                timer.cancel()

        timer = self._node.create_timer(POLL_S, look)
        self._executor.wake()

    def request(self, node: str, transition: str) -> None:
        """Ask a node for a transition by its name; `Answered` follows."""
        future = self._change_state(node, transition)
        future.add_done_callback(partial(self._on_answer, node, transition))

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows."""

        def tell(future: Any) -> None:
            self._hear(StateAnswered(node=node, state=str(future.result().current_state.label)))

        self._call(node, "get_state").add_done_callback(tell)

    def change(self, node: str, transition: str, timeout_s: float) -> Answered | None:
        """Ask a node for a transition and wait; None when no answer came in time."""
        response = self._wait(self._change_state(node, transition), timeout_s)
        if response is None:
            return None
        fault = "" if response.success else self.last_fault(node, timeout_s)
        return Answered(
            node=node, transition=transition, success=bool(response.success), fault=fault
        )

    def state(self, node: str, timeout_s: float) -> str | None:
        """A node's state; None when no answer came in time."""
        if not self._wait_until(self._client(node, "get_state").service_is_ready, timeout_s):
            return None
        response = self._wait(self._call(node, "get_state"), timeout_s)
        return None if response is None else str(response.current_state.label)

    def last_fault(self, node: str, timeout_s: float) -> str:
        """What an Obelisk node says of its newest fault; empty when it says nothing."""
        if not self._wait_until(self._client(node, "last_error").service_is_ready, timeout_s):
            return ""
        response = self._wait(self._call(node, "last_error"), timeout_s)
        return "" if response is None else str(response.message)

    def find(self, expected: Iterable[str], timeout_s: float, quiet_s: float) -> tuple[str, ...]:
        """Full names of the life-cycle nodes in the graph.

        Returns as soon as all expected ones are there; without any expected, when there are some
        and the graph has not changed for `quiet_s`; at the latest after `timeout_s`.
        """
        wanted = frozenset(expected)
        end = time.monotonic() + timeout_s
        seen: frozenset[str] = frozenset()
        changed = time.monotonic()
        while (now := time.monotonic()) < end:
            found = frozenset(self._life_cycle_nodes())
            if found != seen:
                seen, changed = found, now
            is_quiet = bool(seen) and now - changed > quiet_s
            if (wanted and wanted <= seen) or (not wanted and is_quiet):
                break
            time.sleep(POLL_S)
        return tuple(sorted(seen))

    def taken(self, names: Iterable[str], discovery_s: float) -> tuple[str, ...]:
        """Those of the full names that other nodes in the graph have already.

        Returns once this node has had `discovery_s` since its start to find the others.
        """
        wanted = frozenset(names)

        def found() -> tuple[str, ...]:
            there = self._node.get_node_names_and_namespaces()
            return tuple(sorted(wanted & {f"{space.rstrip('/')}/{name}" for name, space in there}))

        left = self._begin + discovery_s - time.monotonic()
        self._wait_until(lambda: bool(found()), left)
        return found()

    def _life_cycle_nodes(self) -> Iterator[str]:
        for service, types in self._node.get_service_names_and_types():
            if service.endswith("/get_state") and GET_STATE in types:
                yield service.removesuffix("/get_state")

    def _client(self, node: str, service: str) -> Any:
        with self._lock:
            if (node, service) not in self._clients:
                self._clients[node, service] = self._node.create_client(
                    self._types[service], f"{node}/{service}"
                )
            return self._clients[node, service]

    def _call(self, node: str, service: str) -> Any:
        return self._client(node, service).call_async(self._types[service].Request())

    def _change_state(self, node: str, transition: str) -> Any:
        request = self._types["change_state"].Request()
        # By name: the number of `shutdown` depends on the state, and an unknown number kills
        # nodes of plain rclpy.
        request.transition.label = transition
        return self._client(node, "change_state").call_async(request)

    def _on_answer(self, node: str, transition: str, future: Any) -> None:
        response = future.result()

        def answer(fault: str) -> None:
            self._hear(
                Answered(
                    node=node, transition=transition, success=bool(response.success), fault=fault
                )
            )

        if response.success:
            answer("")
        else:
            self._ask_fault(node, answer)

    def _ask_fault(self, node: str, tell: Callable[[str], None]) -> None:
        if self._client(node, "last_error").service_is_ready():
            future = self._call(node, "last_error")
            future.add_done_callback(lambda done: tell(str(done.result().message)))
        else:
            tell("")

    def _on_transition_event(self, node: str, event: Any) -> None:
        goal = str(event.goal_state.label)
        transition = IN_TRANSITION.get(str(event.start_state.label), "")
        if goal in RESTING:
            self._hear(StateSeen(node=node, state=goal, transition=transition))
        elif goal == "errorprocessing":
            self._ask_fault(node, partial(self._tell_fault, node, transition))

    def _tell_fault(self, node: str, transition: str, fault: str) -> None:
        self._hear(Failed(node=node, fault=fault, transition=failed_transition(transition, fault)))

    def _wait(self, future: Any, timeout_s: float) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        self._executor.wake()
        return future.result() if done.wait(timeout_s) else None

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        end = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end:
                return False
            time.sleep(POLL_S)
        return True
