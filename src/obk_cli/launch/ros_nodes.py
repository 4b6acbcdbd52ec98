"""Access the nodes of a stack over ROS: send requests, turn what nodes report into input events.

A node that is watched again runs in a new process. The previous one may stay in the graph for the
duration of its DDS lease, so a node counts as ready only when it answers a new query.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from functools import partial
from types import TracebackType
from typing import Any, Final

from obelisk_spec.runtime_protocol import (
    ACTIVATION,
    DIAGNOSTICS_TOPIC,
    FIRST_OUTPUT,
    parse_rate,
    parse_rejection,
    parse_value,
)
from obelisk_spec.video import parse_video
from obk_cli.launch.events import (
    FAULT_TRANSITIONS,
    UNKNOWN_FAULT,
    ActivationReported,
    Answered,
    Failed,
    InputEvent,
    RatesReported,
    Ready,
    RejectionReported,
    StateAnswered,
    StateSeen,
    TransitionStarted,
    VideoReported,
)
from obk_cli.launch.transitions import PASSED
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.lifecycle_client import LifecycleClient, NodeClients, open_client
from obk_cli.runs.lifecycle import RESTING

__all__ = [
    "NodeWatch",
    "RosNodes",
    "activation_of",
    "event_of_transition",
    "failed_transition",
    "open_ros_nodes",
    "rates_of",
    "subscribe_to_diagnostics",
]

POLL_S: Final = 0.01
SLOW_POLL_S: Final = 0.1
"""Replaces `POLL_S` after `FAST_POLLING_S`: nodes that start later are started by hand [s]."""
FAST_POLLING_S: Final = 10.0
ASK_AGAIN_S: Final = 0.1
"""Repeat interval: a query that reaches only a dead server is lost [s]."""
ASK_AGAIN_FIRST_S: Final = 0.02
"""First repeat interval: a server may not know the client yet [s]."""
FAULT_S: Final = 1.0
"""Limit for a failed node to report its fault [s]."""
DEPTH: Final = 100
"""Queue depth: all nodes of a large stack may report their rates at the same time."""


def open_ros_nodes(name: str, environment: RosEnvironment) -> AbstractContextManager["RosNodes"]:
    """Open a ROS node that communicates with the nodes of a stack, and spin it in a thread.

    Args:
        name: the node's name; the process id is added.
        environment: applied to this process first.

    Raises:
        CommandFailedError: rclpy is missing, or does not start.
    """
    return open_client(name, environment, RosNodes)


class RosNodes(LifecycleClient):
    """Sends requests without waiting; reports the results as events."""

    def __init__(
        self, name: str, context: Any, executor: Any, begin_s: float | None = None
    ) -> None:
        """Create the node; see `LifecycleClient`."""
        super().__init__(name, context, executor, begin_s)
        self._on_event: Callable[[InputEvent], None] = lambda _: None
        self._watch = NodeWatch(self._node, self._clients, self._report)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._watch.close()
        super().__exit__(kind, error, trace)

    def report_to(self, on_event: Callable[[InputEvent], None]) -> None:
        """Report events to `on_event` from now on, from a thread."""
        self._on_event = on_event

    def report_diagnostics(self, nodes: Iterable[str]) -> None:
        """Report what these nodes publish on `/diagnostics`: rates, activations, videos."""
        subscribe_to_diagnostics(self._node, nodes, self._report)

    def prepare(self, nodes: Iterable[str]) -> None:
        """Create the subscriptions and clients for these nodes before they start."""
        self._watch.prepare(nodes)

    def watch(self, nodes: Iterable[str]) -> None:
        """Watch these nodes: report `Ready` when their services answer, then their events.

        A node that was watched before runs in a new process; `Ready` follows for that one.
        """
        self._watch.watch(nodes)

    def request(self, node: str, transition: str) -> None:
        """Request a transition of a node; `Answered` follows unless the node dies."""

        def answer(future: Any) -> None:
            if future.result().success:
                report(True, "")
            else:
                self._watch.report_fault(node, lambda fault: report(False, fault))

        def report(success: bool, fault: str) -> None:
            answered = Answered(node=node, transition=transition, success=success, fault=fault)
            self._on_event(answered)

        self._clients.change_state(node, transition).add_done_callback(answer)

    def publishes_diagnostics(self, node: str) -> bool:
        """Whether a node publishes `/diagnostics`, and therefore reports its own rates."""
        ends = self.participant().topic(DIAGNOSTICS_TOPIC).publishers
        return any(end.node == node for end in ends)

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows unless the node is gone or hangs."""

        def report(future: Any) -> None:
            state = str(future.result().current_state.label)
            self._on_event(StateAnswered(node=node, state=state))

        self._clients.ask_state(node).add_done_callback(report)

    def taken(self, names: Iterable[str], discovery_s: float) -> tuple[str, ...]:
        """The full names that other nodes already have; see `RosGraph.taken`."""
        return self.graph.taken(names, discovery_s)

    def foreign_publishers(
        self, topics: Iterable[str], ours: Iterable[str], discovery_s: float
    ) -> tuple[tuple[str, str], ...]:
        """Other nodes that publish on these topics; see `RosGraph.foreign_publishers`."""
        return self.graph.foreign_publishers(topics, ours, discovery_s)

    def _report(self, event: InputEvent) -> None:
        self._on_event(event)


def failed_transition(passed: str, fault: str) -> str:
    """The transition to which a fault belongs; empty if there was none.

    A node that fails outside a transition enters error processing through one of
    `FAULT_TRANSITIONS`; its fault then names another callback. If the fault is not known, this
    returns `passed`.

    Args:
        passed: the transition through which the node entered error processing.
        fault: see `Failed`.
    """
    may_be_own = passed in FAULT_TRANSITIONS and fault not in ("", UNKNOWN_FAULT)
    return "" if may_be_own and not fault.startswith(f"on_{passed}:") else passed


def event_of_transition(node: str, start: str, goal: str) -> StateSeen | TransitionStarted | None:
    """The event for a node that went from one state to another; None for error processing.

    Args:
        node: its full name.
        start: a state's label.
        goal: a state's label.
    """
    if goal in PASSED:
        return TransitionStarted(node=node, transition=PASSED[goal])
    if goal in RESTING:
        return StateSeen(node=node, state=goal, transition=PASSED.get(start, ""))
    return None


class NodeWatch:
    """Reports events of nodes, from the thread that spins.

    Waiting nodes are polled in a separate thread: with rclpy before 7.1.4, a timer would make the
    executor examine all clients of a large stack each time, which takes longer than the poll.
    """

    def __init__(
        self,
        node: Any,
        clients: NodeClients,
        on_event: Callable[[InputEvent], None],
    ) -> None:
        """Start without nodes.

        Args:
            node: the rclpy node that subscribes.
            clients: those of the nodes that will be watched.
            on_event: receives `Ready`, `TransitionStarted`, `StateSeen` and `Failed`.
        """
        self._node = node
        self._clients = clients
        self._on_event = on_event
        self._subscribed: set[str] = set()
        self._waiting: dict[str, _Wait] = {}
        self._starts: Counter[str] = Counter()
        """Node -> number of its processes so far; each is watched once."""
        self._lock = threading.Lock()
        self._begin = 0.0
        self._is_over = threading.Event()
        self._seeker: threading.Thread | None = None
        """Polls the waiting nodes; None if none wait."""

    def close(self) -> None:
        """Stop polling; call this before the node is destroyed."""
        with self._lock:
            self._is_over.set()
            seeker = self._seeker
        if seeker is not None:
            seeker.join()

    def prepare(self, nodes: Iterable[str]) -> None:
        """Create the subscriptions and clients for these nodes before they start."""
        for name in nodes:
            self._subscribe(name)
            self._clients.open(name)

    def watch(self, nodes: Iterable[str]) -> None:
        """Watch these nodes; `Ready` follows for each, even if it was watched before."""
        names = tuple(nodes)
        self.prepare(names)
        with self._lock:
            self._waiting |= {name: _Wait() for name in names}
            self._starts.update(names)
            self._begin = time.monotonic()
            if self._seeker is None and not self._is_over.is_set():
                self._seeker = threading.Thread(target=self._seek, name="watch", daemon=True)
                self._seeker.start()

    def report_fault(self, node: str, report: Callable[[str], None]) -> None:
        """Query a node's latest fault, and call `report` with it.

        It is called once, with `UNKNOWN_FAULT` if the node does not answer in time, and with "" if
        it has no such service. It is not called if the node has been restarted in the meantime.
        """
        if not self._clients.is_ready(node, "last_error"):
            report("")
            return
        pending, start = threading.Lock(), self._starts[node]

        def report_once(fault: str) -> None:
            if pending.acquire(blocking=False):
                timer.cancel()
                if self._starts[node] == start:
                    report(fault)

        timer = threading.Timer(FAULT_S, report_once, [UNKNOWN_FAULT])
        timer.daemon = True
        timer.start()
        future = self._clients.ask_fault(node)
        future.add_done_callback(lambda done: report_once(str(done.result().message)))

    def _subscribe(self, name: str) -> None:
        from lifecycle_msgs.msg import TransitionEvent

        if name not in self._subscribed:
            self._subscribed.add(name)
            topic = f"{name}/transition_event"
            self._node.create_subscription(
                TransitionEvent, topic, partial(self._on_transition_event, name), 10
            )

    def _seek(self) -> None:
        """Query the waiting nodes repeatedly until all have answered."""
        pause_s = 0.0
        while not self._is_over.wait(pause_s):
            now = time.monotonic()
            with self._lock:
                waiting = tuple(self._waiting.items())
                if not waiting:
                    self._seeker = None
                    return
                pause_s = SLOW_POLL_S if now - self._begin > FAST_POLLING_S else POLL_S
            self._ask(waiting, now)

    def _ask(self, waiting: Iterable[tuple[str, "_Wait"]], now: float) -> None:
        for name, wait in waiting:
            if now - wait.queried > wait.pause_s and self._has_services(name):
                wait.queried, wait.pause_s = now, min(2 * wait.pause_s, ASK_AGAIN_S)
                self._clients.ask_state(name).add_done_callback(partial(self._ready, name, wait))

    def _has_services(self, name: str) -> bool:
        return all(self._clients.is_ready(name, kind) for kind in ("change_state", "get_state"))

    def _ready(self, name: str, wait: "_Wait", answer: Any) -> None:
        with self._lock:
            if self._waiting.get(name) is not wait:
                return
            del self._waiting[name]
        self._on_event(Ready(node=name, state=str(answer.result().current_state.label)))

    def _on_transition_event(self, node: str, event: Any) -> None:
        start, goal = str(event.start_state.label), str(event.goal_state.label)
        seen = event_of_transition(node, start, goal)
        if seen is not None:
            self._on_event(seen)
        elif goal == "errorprocessing":
            self.report_fault(node, partial(self._report_failed, node, PASSED.get(start, "")))

    def _report_failed(self, node: str, passed: str, fault: str) -> None:
        self._on_event(Failed(node=node, fault=fault, transition=failed_transition(passed, fault)))


class _Wait:
    """A wait for a node's first answer after watching began."""

    def __init__(self) -> None:
        self.queried = 0.0
        """When the node was last queried [s]."""
        self.pause_s = ASK_AGAIN_FIRST_S
        """Time until the next query [s]."""


def subscribe_to_diagnostics(
    node: Any,
    nodes: Iterable[str],
    on_event: Callable[
        [ActivationReported | RatesReported | RejectionReported | VideoReported], None
    ],
) -> None:
    """Report rates, activations, rejections and videos of these nodes, from the spinning thread.

    Args:
        node: the rclpy node that subscribes.
        nodes: full names; reports of other nodes are ignored.
        on_event: receives the reports.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    names = frozenset(nodes)

    def on_message(message: Any) -> None:
        for read in (rates_of, activation_of, rejection_of, video_of):
            event = read(message)
            if event is not None and event.node in names:
                on_event(event)

    node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, on_message, DEPTH)


def rates_of(message: Any) -> RatesReported | None:
    """The rates in a `diagnostic_msgs/DiagnosticArray`; None if it has none."""
    found = tuple(
        rate
        for status in message.status
        if (rate := parse_rate(status.name, status.level[0], _values(status))) is not None
    )
    return RatesReported(node=str(message.status[0].hardware_id), rates=found) if found else None


def activation_of(message: Any) -> ActivationReported | None:
    """The activation in a `diagnostic_msgs/DiagnosticArray`; None if it has none."""
    times = {
        what: time_s
        for status in message.status
        for what in (ACTIVATION, FIRST_OUTPUT)
        if (time_s := parse_value(what, status.name, _values(status))) is not None
    }
    if ACTIVATION not in times:
        return None
    return ActivationReported(
        node=str(message.status[0].hardware_id),
        simulated_s=times[ACTIVATION],
        first_output_s=times.get(FIRST_OUTPUT),
    )


def rejection_of(message: Any) -> RejectionReported | None:
    """The rejections in a `diagnostic_msgs/DiagnosticArray`; None if it has none."""
    for status in message.status:
        rejection = parse_rejection(status.name, _values(status))
        if rejection is not None:
            seconds, reason = rejection
            return RejectionReported(node=str(status.hardware_id), seconds=seconds, reason=reason)
    return None


def video_of(message: Any) -> VideoReported | None:
    """The video in a `diagnostic_msgs/DiagnosticArray`; None if it has none."""
    for status in message.status:
        video = parse_video(status.name, _values(status))
        if video is not None:
            return VideoReported(node=str(status.hardware_id), video=video)
    return None


def _values(status: Any) -> dict[str, str]:
    return {str(pair.key): str(pair.value) for pair in status.values}
