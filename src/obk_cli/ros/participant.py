"""Observe a ROS graph with a bare participant: no executor, no services, nothing published.

rclpy's own node adds a publisher, a service and the packages of their types, which takes longer
than the queries themselves. Results are polled, every wait has a limit, and errors of rclpy are
converted to errors of obk here.
"""

import ctypes
import importlib
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TypeVar
from weakref import WeakSet

from obk_cli.errors import CommandFailedError
from obk_cli.optional_deps import no_ros
from obk_cli.process.shared_memory import require_shared_memory
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.graph import GraphEndpoint, GraphSnapshot, Role, TopicInfo, full_name
from obk_cli.ros.raw_subscription import RawSubscription, offered_qos

__all__ = [
    "OBSERVER_NODE",
    "RosParticipant",
    "make_bare_node",
    "open_context",
    "open_participant",
    "remove_participant",
]

PACKAGE: Final = "rosidl_generator_py"
GENERATOR: Final = f"{PACKAGE}.generate_py_impl"


def defer_message_generator() -> None:
    """Import `rosidl_generator_py` so that its generator is imported on first use.

    It does nothing if the package is already imported, or not installed.
    """
    if PACKAGE in sys.modules or GENERATOR in sys.modules:
        return
    sys.modules[GENERATOR] = None  # type: ignore[assignment]
    try:
        package = importlib.import_module(PACKAGE)
    except ImportError:  # the first use of a message reports that ROS is missing
        return
    finally:
        del sys.modules[GENERATOR]
    package.__getattr__ = _late  # type: ignore[method-assign]


def _late(name: str) -> object:
    """The attribute that the package would have had from the start: `generate_py`."""
    if name != "generate_py":
        raise AttributeError(f"module {PACKAGE!r} has no attribute {name!r}")
    return importlib.import_module(GENERATOR).generate_py


T = TypeVar("T")

OBSERVER_NODE: Final = "obk_look"
"""Name of the node of a command that only observes; the process id follows."""
POLL_S: Final = 0.005
"""Polling period [s]."""
QUIET_S: Final = 0.03
"""Time without a change after which a graph with all expected nodes is complete [s]."""


@contextmanager
def open_participant(
    environment: RosEnvironment, needs: Iterable[str] = (), name: str = OBSERVER_NODE
) -> "Iterator[RosParticipant]":
    """Open a participant in the ROS domain of the environment.

    Args:
        environment: applied to this process first.
        needs: modules that will be needed; they are imported during discovery.
        name: name of the node; the process id is added.

    Raises:
        CommandFailedError: rclpy is missing, or does not start.
    """
    require_shared_memory()
    with open_context(environment) as context:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        try:
            node = make_bare_node(context, name)
        except Exception as error:
            raise CommandFailedError(f"ROS 2 does not start: {error}") from error
        for module in ("rclpy.topic_endpoint_info", *needs):
            # Its first use reports the error.
            with suppress(Exception):
                importlib.import_module(module)
        participant = RosParticipant(node, rclpy_implementation, environment.domain)
        try:
            yield participant
        finally:
            remove_participant(participant.close)


@contextmanager
def open_context(environment: RosEnvironment) -> Iterator[Any]:
    """Open an rclpy context in the ROS domain of the environment.

    Args:
        environment: applied to this process first.

    Raises:
        CommandFailedError: rclpy is missing, or does not start.
    """
    environment.put_into_effect()
    # NumPy, which messages load, starts threads for linear algebra, which obk does not use. At its
    # start, each of them keeps a core busy for 50 ms. Nodes do not inherit the variable, because
    # `environment` was read before.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from rclpy.context import Context
    except ImportError as error:
        raise no_ros(error) from error
    context: Any = Context()
    try:
        context.init(domain_id=environment.domain)
    except Exception as error:
        context.try_shutdown()
        raise CommandFailedError(f"ROS 2 does not start: {error}") from error
    defer_message_generator()
    try:
        yield context
    finally:
        context.try_shutdown()
        _exit_before_destructors()


def _exit_before_destructors() -> None:
    """End this process once the interpreter is done, before Fast DDS's destructors run.

    The destructor of its global factory sleeps for 0.1 s. The last handler to be registered is
    called first, so this must be called after a participant was created. Source: on_exit(3).
    """
    libc = ctypes.CDLL(None)
    libc.on_exit(libc._exit, None)


def make_bare_node(context: Any, name: str = OBSERVER_NODE) -> Any:
    """Create a node handle that publishes and serves nothing; discovery starts with it.

    Args:
        context: the context from `open_context`.
        name: name of the node; the process id is added.
    """
    from rclpy.impl.implementation_singleton import rclpy_implementation

    with context.handle:
        return rclpy_implementation.Node(
            f"{name}_{os.getpid()}", "", context.handle, [], False, False
        )


def remove_participant(remove: Callable[[], object]) -> None:
    """Remove a participant with all threads of this process on one core.

    Meanwhile, Fast DDS waits for its discovery threads and repeatedly takes the lock they need. On
    another core, a thread may not get the lock for minutes, if another participant leaves at the
    same time.

    Args:
        remove: the function that removes it.
    """
    cores = os.sched_getaffinity(0)
    _run_on({min(cores)})
    try:
        remove()
    finally:
        _run_on(cores)


def _run_on(cores: Collection[int]) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(ProcessLookupError):  # the thread has ended
            os.sched_setaffinity(int(thread.name), cores)


class RosParticipant:
    """A bare participant: the ROS graph as it sees it, and its own subscriptions."""

    def __init__(self, node: Any, functions: Any, domain: int) -> None:
        """Start discovery.

        Args:
            node: rclpy's node handle.
            functions: the compiled part of rclpy.
            domain: the ROS domain.
        """
        self.node: Final = node
        with node:
            self.name: Final = f"/{node.get_node_name()}"
            """Full name of the participant's own node."""
        self.domain: Final = domain
        self._subscriptions: WeakSet[RawSubscription] = WeakSet()
        self._functions = functions
        self._begin = time.monotonic()

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the topics discovered so far."""
        with self.node:
            entries = self._functions.rclpy_get_topic_names_and_types(self.node, False)
        return {name: tuple(types) for name, types in sorted(entries)}

    def service_types(self) -> dict[str, tuple[str, ...]]:
        """Full name -> types of the services discovered so far."""
        with self.node:
            entries = self._functions.rclpy_get_service_names_and_types(self.node)
        return {name: tuple(types) for name, types in sorted(entries)}

    def nodes(self) -> tuple[str, ...]:
        """Full names of the other nodes discovered so far."""
        with self.node:
            entries = self.node.get_node_names_and_namespaces()
            own = self.node.get_node_name()
        names = (full_name(name, space) for name, space in entries if name != own)
        return tuple(sorted(name for name in names if name))

    def topics_of(self, node: str) -> tuple[dict[str, tuple[str, ...]], ...]:
        """Topic -> types of a node's publishers, and of its subscriptions."""
        return (
            self._of(self._functions.rclpy_get_publisher_names_and_types_by_node, node, False),
            self._of(self._functions.rclpy_get_subscriber_names_and_types_by_node, node, False),
        )

    def services_of(self, node: str) -> dict[str, tuple[str, ...]]:
        """Full name -> types of a node's services."""
        return self._of(self._functions.rclpy_get_service_names_and_types_by_node, node)

    def topic(self, name: str) -> TopicInfo:
        """A topic with the endpoints discovered so far."""
        publishers = self._endpoints(name, "publisher")
        subscriptions = self._endpoints(name, "subscription")
        types = dict.fromkeys(end.msg_type for end in (*publishers, *subscriptions))
        return TopicInfo(
            name=name,
            msg_types=tuple(types),
            publishers=publishers,
            subscriptions=subscriptions,
        )

    def graph(self) -> GraphSnapshot:
        """The graph as discovered so far."""
        return GraphSnapshot(
            nodes=self.nodes(),
            topics=tuple(self.topic(name) for name in self.topic_types()),
            services=self.service_types(),
        )

    def settle(self, expected: Collection[str], quiet_s: float, timeout_s: float) -> bool:
        """Wait until the expected nodes are present and the graph has stopped changing.

        Args:
            expected: full names; empty: any node.
            quiet_s: required time without changes if no nodes are expected [s].
            timeout_s: limit since the start [s].

        Returns:
            Whether the expected nodes exist; if none are expected, whether any node exists.
        """
        required = frozenset(expected)
        seen: object = None
        changed = time.monotonic()
        while True:
            nodes, now = self.nodes(), time.monotonic()
            entries = (nodes, self.topic_types(), self.service_types())
            if entries != seen:
                seen, changed = entries, now
            is_all = required <= set(nodes) and bool(nodes)
            is_quiet = now - changed > (QUIET_S if required else quiet_s)
            if (is_all and is_quiet) or now > self._begin + timeout_s:
                return is_all
            time.sleep(POLL_S)

    def rest(self, seconds: float) -> None:
        """Continue discovery until this time after the start [s]."""
        time.sleep(max(0.0, self._begin + seconds - time.monotonic()))

    def wait_for(self, probe: Callable[[], T | None], timeout_s: float) -> T | None:
        """Poll a probe until it returns a result; None if it returns none in time."""
        end = time.monotonic() + timeout_s
        while (found := probe()) is None and time.monotonic() < end:
            time.sleep(POLL_S)
        return found

    def subscribe(
        self, name: str, msg_type: str, python_type: Any, *, is_light: bool = False
    ) -> RawSubscription:
        """Subscribe to a topic with the QoS that its publishers offer.

        Args:
            name: full name.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            is_light: cause little load for publishers, even if messages may be missed.
        """
        raw = RawSubscription(self.node, name, msg_type, python_type, is_light=is_light)
        self._subscriptions.add(raw)
        return raw

    def close(self) -> None:
        """Leave the ROS graph and close all subscriptions."""
        for raw in tuple(self._subscriptions):
            raw.close()
        self.node.destroy_when_not_in_use()

    def _of(self, ask: Any, node: str, *hidden: bool) -> dict[str, tuple[str, ...]]:
        namespace, _, name = node.rpartition("/")
        with self.node:
            try:
                entries = ask(self.node, *hidden, name, namespace or "/")
            except self._functions.NodeNameNonExistentError:  # it has ended in the meantime
                entries = []
        return {name: tuple(types) for name, types in sorted(entries)}

    def _endpoints(self, name: str, role: Role) -> tuple[GraphEndpoint, ...]:
        ask = (
            self._functions.rclpy_get_publishers_info_by_topic
            if role == "publisher"
            else self._functions.rclpy_get_subscriptions_info_by_topic
        )
        with self.node:
            entries = ask(self.node, name, False)
        return tuple(_endpoint(info, role) for info in entries)


def _endpoint(info: dict[str, Any], role: Role) -> GraphEndpoint:
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    end = TopicEndpointInfo(**info)  # type: ignore[no-untyped-call]
    return GraphEndpoint(
        node=full_name(end.node_name, end.node_namespace),
        role=role,
        msg_type=end.topic_type,
        qos=offered_qos(end.qos_profile),
        type_hash=str(end.topic_type_hash),
        gid=bytes(end.endpoint_gid).hex(),
    )
