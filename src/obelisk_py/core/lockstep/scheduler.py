"""Schedule the events of a lockstep run in simulated time and a defined order.

Each event has a due time. Events due at the same time run in this order: steps of simulators,
events postponed by busy nodes, faults, messages in the order of publication, and timers in the
order of creation. Nothing waits, and everything runs on one thread.

A callback may take simulated time, because it sleeps or because its computing time is modeled. In
that case, only the callback's node moves ahead: what it publishes from then on is stamped with the
advanced time, and the node's next events are postponed. Nodes share nothing but messages, so no
other node can observe the difference.
"""

import heapq
import random
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType
from typing import Any, Final, TypeVar

from obelisk_py.core.exceptions import ObeliskError

__all__ = [
    "FAULT",
    "MESSAGE",
    "NS_PER_S",
    "STEP",
    "TIMER",
    "Arrival",
    "LockstepError",
    "ScheduledNode",
    "Scheduler",
    "TimingModel",
    "user_place",
    "wait_ns",
]

NS_PER_S: Final = 1_000_000_000
_LIBRARIES: Final = ("obelisk_py.core.", "rclpy.", "threading.", "queue.", "sched.", "asyncio.")
_STOP: Final = -1
"""Kind of the event that ends a run with an error; it runs before other events with the same due
time."""
STEP, _PUT_OFF, FAULT, MESSAGE, TIMER = range(5)
"""Kinds of events, in the order in which events due at the same time run."""
MOST_AT_ONE_TIME: Final = 100_000
"""Maximum number of events without time advancing; exceeding it ends the run."""
_LONGEST_CALLBACK_NS: Final = 1_000 * NS_PER_S
"""Maximum time that a callback may sleep. A callback that sleeps longer is probably waiting for
another event, which cannot occur while the callback runs."""
_TRACED: Final = 64
"""Number of events to trace when nodes trigger each other endlessly."""

_Error = TypeVar("_Error", bound=Exception)
Event = tuple[int, int, Any, "ScheduledNode | None", Callable[[], object]]
"""Due time [ns], kind, position among events with the same time and kind, node, call."""


class LockstepError(ObeliskError):
    """A node did something that is impossible in lockstep; the message names an alternative."""


class Arrival(ABC):
    """The callable of an event that delivers a message to a subscription."""

    __slots__ = ()

    @property
    @abstractmethod
    def label(self) -> str:
        """The topic."""

    @abstractmethod
    def __call__(self) -> bool:
        """Deliver the message; return False if it is dropped."""

    @abstractmethod
    def enqueue(self) -> Callable[[], bool]:
        """Put the message into the subscription's history.

        Returns:
            The call that delivers it from there, if newer messages have not displaced it.
        """


@dataclass(slots=True, eq=False)
class ScheduledNode:
    """A node and its state in the scheduler."""

    name: str
    """Full name."""
    node: Any
    others: list[Any] = field(default_factory=list)
    """Nodes that its code has created; they are scheduled together with it."""
    compute_ns: int = 0
    """Computing time of each of its callbacks [ns]."""
    is_alive: bool = True
    freezes: int = 0
    """Number of reasons for which it is frozen."""
    busy_until_ns: int = 0
    held: list[Event] = field(default_factory=list)
    """Events that became due while it was frozen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingModel:
    """Delays compared to an ideal run, in which nothing takes time; all times in seconds."""

    latency: float = 0.0
    """Time from publishing a message to its arrival."""
    jitter: float = 0.0
    """Upper limit of the random delay that is added to the latency of each message."""
    random_phases: bool = False
    """Whether each timer's first tick is delayed by a random fraction of its period."""


class Scheduler:
    """Simulated time and the pending events."""

    def __init__(self, *, seed: int = 0, timing: TimingModel | None = None) -> None:
        """Start at time 0 without events.

        Args:
            seed: seed of the random latencies, phases and faults.
            timing: None for an ideal run.
        """
        timing = timing or TimingModel()
        self.now_ns = 0
        """Time of the running event [ns]."""
        self.offset_ns = 0
        """Time that the running callback has taken so far [ns]."""
        self.running: ScheduledNode | None = None
        """The node whose callback is running."""
        self.calls = 0
        """Number of callbacks that have begun."""
        self.thread_id = threading.get_ident()
        self._seed = seed
        self._phases = random.Random(f"schedule {seed}")  # noqa: S311
        self._delays: dict[str, random.Random] = {}
        self.on_exit: Callable[[ScheduledNode, str], None] = lambda _node, _how: None
        """Called when a node's code exits its process."""
        self.notes: list[str] = []
        """Notes for the user about this run, without duplicates, each with its time."""
        self.latency_ns = round(timing.latency * NS_PER_S)
        self.jitter_ns = round(timing.jitter * NS_PER_S)
        self._has_random_phases = timing.random_phases
        self._heap: list[Event] = []
        self._pushed = 0
        self._timers_made = 0
        self._noted: set[object] = set()

    @property
    def time_ns(self) -> int:
        """Time as seen by the running callback [ns]."""
        return self.now_ns + self.offset_ns

    def push(
        self, due_ns: int, kind: int, node: ScheduledNode | None, call: Callable[[], object]
    ) -> None:
        """Schedule a call; if it returns False, it takes no computing time."""
        self._pushed += 1
        heapq.heappush(self._heap, (due_ns, kind, self._pushed, node, call))

    def push_at_place(
        self,
        due_ns: int,
        kind: int,
        place: int,
        node: ScheduledNode | None,
        call: Callable[[], Any],
    ) -> None:
        """Like `push`, with a given position among the events with that time and kind."""
        heapq.heappush(self._heap, (due_ns, kind, place, node, call))

    def next_place(self) -> int:
        """Reserve and return the position that `push` would assign now."""
        self._pushed += 1
        return self._pushed

    def next_timer(self) -> int:
        """Return the number of a new timer."""
        self._timers_made += 1
        return self._timers_made

    def phase_ns(self, period_ns: int) -> int:
        """Return the delay of a timer's first tick beyond its period [ns]."""
        return self._phases.randrange(period_ns) if self._has_random_phases and period_ns else 0

    def delay_ns(self, channel: str) -> int:
        """Return the latency of a message on a topic, service or action [ns].

        Each channel has its own random numbers, so observing one does not change the others.
        """
        if not self.jitter_ns:
            return self.latency_ns
        draws = self._delays.get(channel)
        if draws is None:
            draws = self._delays[channel] = random.Random(f"delay {channel} {self._seed}")  # noqa: S311
        return self.latency_ns + int(draws.random() * (self.jitter_ns + 1))

    def next_due_ns(self, most_ns: int) -> int:
        """Return the due time of the next event, or `most_ns` if that is earlier [ns]."""
        return min(self._heap[0][0], most_ns) if self._heap else most_ns

    def run_until(self, end_ns: int) -> None:
        """Run all events up to and including a time [ns].

        Raises:
            LockstepError: nodes trigger each other endlessly without time advancing, or a node did
                something that is impossible in lockstep.
        """
        try:
            while True:
                try:
                    self._run_events(end_ns)
                    break
                except SystemExit as ended:
                    node = self.running
                    self.offset_ns = 0
                    if node is None:
                        raise
                    self.on_exit(node, f"ended its process by raising `SystemExit({ended.code!r})`")
            self.now_ns = max(self.now_ns, end_ns)
        finally:
            self.running, self.offset_ns = None, 0

    def _run_events(self, end_ns: int) -> None:
        heap, pop = self._heap, heapq.heappop
        count = progress = 0
        while heap and heap[0][0] <= end_ns:
            event = pop(heap)
            due_ns, kind, _, node, call = event
            if node is not None:
                if not node.is_alive:
                    continue
                # Steps of a simulator or a guest thread do not wait for the node's callbacks.
                if node.freezes or (kind and node.busy_until_ns > due_ns):
                    self._postpone(event, node)
                    continue
            if due_ns > self.now_ns:
                self.now_ns, progress = due_ns, count
            elif count - progress > MOST_AT_ONE_TIME:
                self._fail_without_progress(event)
            self.running = node
            count += 1
            self.calls += 1
            is_done = call() is not False
            if is_done and node is not None and (self.offset_ns or (node.compute_ns and kind)):
                node.busy_until_ns = due_ns + self.offset_ns + node.compute_ns
            self.offset_ns = 0
        self.running = None

    def _postpone(self, event: Event, node: ScheduledNode) -> None:
        """Keep an event until its node thaws or is no longer busy."""
        due_ns, kind, place, _, call = event
        if isinstance(call, Arrival):  # it arrives even though the node cannot take it yet
            call = call.enqueue()
        if node.freezes:
            node.held.append((due_ns, kind, place, node, call))
            return
        # Postponed events run in the order in which they were first due, so that none starves.
        order = place if kind == _PUT_OFF else (due_ns, kind, place)
        heapq.heappush(self._heap, (node.busy_until_ns, _PUT_OFF, order, node, call))

    def stop(self, error: _Error) -> _Error:
        """End the run with an error, even if the running callback catches it; the first one counts.

        Returns:
            The error, for the callback to raise.
        """

        def fail() -> None:
            raise error

        if not self._is_stopping():
            heapq.heappush(self._heap, (self.now_ns, _STOP, 0, None, fail))
        return error

    def check(self) -> None:
        """Raise the error that ends the run, if any.

        Raises:
            LockstepError: a node did something that is impossible in lockstep.
        """
        if self._is_stopping():
            self._heap[0][4]()

    def _is_stopping(self) -> bool:
        return bool(self._heap) and self._heap[0][1] == _STOP

    def run_as(self, node: ScheduledNode, call: Callable[[], Any]) -> Any:
        """Call a node's function, such as a transition, outside the node's events."""
        before, self.running = self.running, node
        offset_ns, self.offset_ns = self.offset_ns, 0
        self.calls += 1
        try:
            return call()
        finally:
            self.running, self.offset_ns = before, offset_ns

    def sleep(self, seconds: float) -> None:
        """Let the running callback take time, and note where it sleeps.

        Raises:
            LockstepError: the callback has slept too long.
        """
        taken_ns = wait_ns(seconds)
        if not taken_ns:
            return
        name, where = self.running.name if self.running else "a callback", user_place()
        self.note(
            ("sleep", where), f"{name} sleeps at {where}; this counts as the node's computing time"
        )
        self.offset_ns += taken_ns
        if self.offset_ns > _LONGEST_CALLBACK_NS:
            raise self.stop(
                LockstepError(
                    f"{name} has slept for {self.offset_ns / NS_PER_S:,.0f} s in one callback, "
                    f"most recently at {where}: it is waiting for something that cannot happen "
                    "while it waits. Use `await`, a done callback or a timer"
                )
            )

    def note(self, key: object, text: str) -> None:
        """Keep a note unless one with this key exists."""
        if key not in self._noted:
            self._noted.add(key)
            self.notes.append(f"{self.time_ns / NS_PER_S:.6f} s: {text}")

    def freeze(self, node: ScheduledNode) -> None:
        """Run no events of a node until each call of `freeze` has been followed by `thaw`."""
        node.freezes += 1

    def thaw(self, node: ScheduledNode) -> None:
        """End one freeze; after the last one, resume the node and run its postponed events."""
        node.freezes -= 1
        if node.freezes:
            return
        held, node.held = node.held, []
        for due_ns, kind, place, _, call in held:
            if kind in (STEP, _PUT_OFF):
                event = (max(due_ns, self.now_ns), kind, place, node, call)
            else:  # in the order in which they were due, as after a busy period
                event = (max(due_ns, self.now_ns), _PUT_OFF, (due_ns, kind, place), node, call)
            heapq.heappush(self._heap, event)

    def clear(self) -> None:
        """Drop all events and their references to nodes."""
        self._heap.clear()
        self.running = None

    def _fail_without_progress(self, event: Event) -> None:
        """Report the callbacks that trigger each other endlessly."""
        names: dict[str, None] = {}
        for _ in range(_TRACED):
            *_, node, call = event
            if node is not None:
                names.setdefault(f"{node.name} ({_label_of(call)})")
            self.running = node
            call()
            self.offset_ns = 0
            if not self._heap:
                break
            event = heapq.heappop(self._heap)
        raise LockstepError(
            f"{MOST_AT_ONE_TIME:,} events at {self.now_ns / NS_PER_S:.6f} s without time "
            f"advancing: {', '.join(names)} trigger each other; in a real run they would keep one "
            "core fully busy"
        )


def wait_ns(seconds: float) -> int:
    """Convert to ns, but at least 1 ns for times above 0, so that a loop of waits ends."""
    return max(1, round(seconds * NS_PER_S)) if seconds > 0 else 0


def user_place(start: FrameType | None = None) -> str:
    """Return `file:line` of the innermost call outside this library and rclpy.

    Args:
        start: where another thread is; None for the calling one.
    """
    frame: FrameType | None = start or sys._getframe(1)
    while frame is not None and frame.f_back is not None:
        if not f"{frame.f_globals.get('__name__', '')}.".startswith(_LIBRARIES):
            break
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}" if frame is not None else "?"


def _label_of(call: Callable[[], object]) -> str:
    """Return the topic, service or timer of an event."""
    owner = next(iter(getattr(call, "args", ())), getattr(call, "__self__", call))
    return str(getattr(owner, "label", None) or getattr(call, "__qualname__", type(call).__name__))
