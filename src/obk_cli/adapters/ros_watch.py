"""Listening to life-cycle nodes: when they answer, and what they tell of themselves.

A node that is watched once more runs in a new process. The one before may be seen for as long as
its DDS lease lasts, so what counts as ready is an answer to a question asked since.
"""

import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Final

from obk_cli.adapters.ros_clients import NodeClients
from obk_cli.launch.events import Failed, Heard, Ready, StateSeen, TransitionBegun
from obk_cli.launch.state_machine import PASSED
from obk_cli.runs.lifecycle import RESTING

__all__ = ["NodeWatch", "failed_transition", "heard_of_passage"]

LOOK_S: Final = 0.01
SELDOM_S: Final = 0.1
"""Instead of `LOOK_S` once `SOON_S` have gone by: who is not there yet is started by hand [s]."""
SOON_S: Final = 10.0
ASK_AGAIN_S: Final = 0.1
"""A question that reaches only a dead server is lost [s]."""
FAULT_S: Final = 1.0
"""How long a node that failed may take to say why [s]."""


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


def heard_of_passage(node: str, start: str, goal: str) -> StateSeen | TransitionBegun | None:
    """What it means that a node went from one state to another; None for error processing.

    Args:
        node: its full name.
        start: a state's label.
        goal: a state's label.
    """
    if goal in PASSED:
        return TransitionBegun(node=node, transition=PASSED[goal])
    if goal in RESTING:
        return StateSeen(node=node, state=goal, transition=PASSED.get(start, ""))
    return None


class NodeWatch:
    """Tells `hear` of nodes, from the thread that spins."""

    def __init__(
        self,
        node: Any,
        clients: NodeClients,
        hear: Callable[[Heard], None],
        wake: Callable[[], Any],
    ) -> None:
        """Begin with nobody to watch.

        Args:
            node: of rclpy, that listens.
            clients: of the nodes to come.
            hear: takes `Ready`, `TransitionBegun`, `StateSeen` and `Failed`.
            wake: lets the thread that spins know of something new.
        """
        self._node = node
        self._clients = clients
        self._hear = hear
        self._wake = wake
        self._listened: set[str] = set()
        self._waiting: dict[str, _Wait] = {}
        self._lock = threading.Lock()
        self._begin = 0.0
        self._timer = node.create_timer(LOOK_S, self._look)
        self._timer.cancel()

    def watch(self, nodes: Iterable[str]) -> None:
        """Listen for these nodes; `Ready` follows for each, also if it was watched before."""
        names = tuple(nodes)
        for name in names:
            self._listen(name)
            self._clients.open(name)
        with self._lock:
            self._waiting |= {name: _Wait() for name in names}
            self._begin = time.monotonic()
            self._pace(LOOK_S)
        self._wake()

    def tell_fault(self, node: str, tell: Callable[[str], None]) -> None:
        """Ask a node for its newest fault; `tell` is called once, with "" when it has no answer."""
        if not self._clients.is_ready(node, "last_error"):
            tell("")
            return
        untold = threading.Lock()

        def tell_once(fault: str) -> None:
            if untold.acquire(blocking=False):
                timer.cancel()
                tell(fault)

        timer = threading.Timer(FAULT_S, tell_once, [""])
        timer.daemon = True
        timer.start()
        future = self._clients.ask_fault(node)
        future.add_done_callback(lambda done: tell_once(str(done.result().message)))

    def _listen(self, name: str) -> None:
        from lifecycle_msgs.msg import TransitionEvent

        if name not in self._listened:
            self._listened.add(name)
            topic = f"{name}/transition_event"
            self._node.create_subscription(
                TransitionEvent, topic, partial(self._on_passage, name), 10
            )

    def _pace(self, period_s: float) -> None:
        self._timer.timer_period_ns = int(period_s * 1e9)
        self._timer.reset()

    def _look(self) -> None:
        now = time.monotonic()
        with self._lock:
            waiting = tuple(self._waiting.items())
            if not waiting:
                self._timer.cancel()
            elif now - self._begin > SOON_S:
                self._pace(SELDOM_S)
        for name, wait in waiting:
            if now - wait.asked > ASK_AGAIN_S and self._is_there(name):
                wait.asked = now
                self._clients.ask_state(name).add_done_callback(partial(self._ready, name, wait))

    def _is_there(self, name: str) -> bool:
        return all(self._clients.is_ready(name, kind) for kind in ("change_state", "get_state"))

    def _ready(self, name: str, wait: "_Wait", _answer: Any) -> None:
        with self._lock:
            if self._waiting.get(name) is not wait:
                return
            del self._waiting[name]
        self._hear(Ready(node=name))

    def _on_passage(self, node: str, event: Any) -> None:
        start, goal = str(event.start_state.label), str(event.goal_state.label)
        heard = heard_of_passage(node, start, goal)
        if heard is not None:
            self._hear(heard)
        elif goal == "errorprocessing":
            self.tell_fault(node, partial(self._tell_failed, node, PASSED.get(start, "")))

    def _tell_failed(self, node: str, passed: str, fault: str) -> None:
        self._hear(Failed(node=node, fault=fault, transition=failed_transition(passed, fault)))


class _Wait:
    """For a node's first answer since it was watched, and when it was last asked [s]."""

    def __init__(self) -> None:
        self.asked = 0.0
