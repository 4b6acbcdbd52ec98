"""The events of a lock-step run: simulated time, and what happens in which order.

An event is due at a time. Of those due at the same time, steps of simulators come first, then what
a busy node had to put off, faults, messages in the order in which they were published, and timers
in the order in which they were made. Nothing waits, and all of it runs on one thread.

A callback may take simulated time, because it sleeps or because its computing time is modelled.
Only its own node moves ahead then: what it publishes afterwards has that later time, and its next
events are put off. Nodes share nothing but messages, so no other node can notice the difference.
"""

import heapq
import random
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from obelisk_py.core.exceptions import ObeliskError

__all__ = [
    "FAULT",
    "MESSAGE",
    "NS_PER_S",
    "STEP",
    "TIMER",
    "LockstepError",
    "ScheduledNode",
    "Scheduler",
    "TimingModel",
]

NS_PER_S: Final = 1_000_000_000
STEP, _PUT_OFF, FAULT, MESSAGE, TIMER = range(5)
"""Kinds of events, in the order in which those of one time run."""
MOST_AT_ONE_TIME: Final = 100_000
"""Events without progress of time, after which a run ends."""
_TRACED: Final = 64
"""Events that show what the nodes do without end."""

Event = tuple[int, int, Any, "ScheduledNode | None", Callable[[], object]]
"""Due time [ns], kind, place among those of the same time and kind, node, what to call."""


class LockstepError(ObeliskError):
    """What a node does is not possible in lock-step; the message explains what to do instead."""


@dataclass(slots=True, eq=False)
class ScheduledNode:
    """A node, as the scheduler has it."""

    name: str
    """Full name."""
    node: Any
    compute_ns: int = 0
    """Time that each of its callbacks takes [ns]."""
    is_alive: bool = True
    is_frozen: bool = False
    busy_until_ns: int = 0
    held: list[Event] = field(default_factory=list)
    """Events that came while it was frozen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingModel:
    """How a run differs from the ideal one, in which nothing takes time; all times in seconds."""

    latency: float = 0.0
    """From the publication of a message to its arrival."""
    jitter: float = 0.0
    """The most that is added to the latency, drawn for each message."""
    random_phases: bool = False
    """Whether the first tick of a timer comes up to a period later, drawn for each timer."""


class Scheduler:
    """Simulated time and the events that are due."""

    def __init__(self, *, seed: int = 0, timing: TimingModel | None = None) -> None:
        """Start at time 0 without events.

        Args:
            seed: of latencies, phases and faults that are drawn.
            timing: None: the ideal run.
        """
        timing = timing or TimingModel()
        self.now_ns = 0
        """The time of the event that runs [ns]."""
        self.offset_ns = 0
        """Time that the running callback has taken so far [ns]."""
        self.running: ScheduledNode | None = None
        """The node whose callback runs."""
        self.thread_id = threading.get_ident()
        self.random = random.Random(f"schedule {seed}")  # noqa: S311
        self.events_run = 0
        self.notes: list[str] = []
        """What the user should know about this run, each once, with its time."""
        self.latency_ns = round(timing.latency * NS_PER_S)
        self.jitter_ns = round(timing.jitter * NS_PER_S)
        self._has_random_phases = timing.random_phases
        self._heap: list[Event] = []
        self._pushed = 0
        self._timers_made = 0
        self._noted: set[object] = set()

    @property
    def time_ns(self) -> int:
        """The time as the running callback sees it [ns]."""
        return self.now_ns + self.offset_ns

    def push(
        self, due_ns: int, kind: int, node: ScheduledNode | None, call: Callable[[], object]
    ) -> None:
        """Have something called at a time; a call that returns False takes no time."""
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
        """As `push`, with a place of one's own among the events of that time and kind."""
        heapq.heappush(self._heap, (due_ns, kind, place, node, call))

    def push_timer(
        self, due_ns: int, place: int, node: ScheduledNode, call: Callable[[], object]
    ) -> None:
        """Have a timer called, at its place among the timers of that time."""
        heapq.heappush(self._heap, (due_ns, TIMER, place, node, call))

    def next_place(self) -> int:
        """The place that a `push` would get now."""
        self._pushed += 1
        return self._pushed

    def next_timer(self) -> int:
        """The number of a new timer."""
        self._timers_made += 1
        return self._timers_made

    def phase_ns(self, period_ns: int) -> int:
        """How much later than a period the first tick of a timer comes [ns]."""
        return self.random.randrange(period_ns) if self._has_random_phases and period_ns else 0

    def delay_ns(self) -> int:
        """How long a message takes [ns]."""
        jitter_ns = self.random.randrange(self.jitter_ns + 1) if self.jitter_ns else 0
        return self.latency_ns + jitter_ns

    def next_due_ns(self, most_ns: int) -> int:
        """When the next event is due, or `most_ns` if that is earlier [ns]."""
        return min(self._heap[0][0], most_ns) if self._heap else most_ns

    def run_until(self, end_ns: int) -> None:
        """Run all events up to a time [ns], those at it included.

        Raises:
            LockstepError: the nodes cause events without end at one time.
        """
        heap, pop, push = self._heap, heapq.heappop, heapq.heappush
        count = progress = 0
        while heap and heap[0][0] <= end_ns:
            event = pop(heap)
            due_ns, kind, place, node, call = event
            if node is not None:
                if not node.is_alive:
                    continue
                if node.is_frozen:
                    node.held.append(event)
                    continue
                if node.busy_until_ns > due_ns:
                    # In the order in which they were due first, so that none starves.
                    order = place if kind == _PUT_OFF else (due_ns, kind, place)
                    push(heap, (node.busy_until_ns, _PUT_OFF, order, node, call))
                    continue
            if due_ns > self.now_ns:
                self.now_ns, progress = due_ns, count
            elif count - progress > MOST_AT_ONE_TIME:
                self._fail_without_progress(event)
            self.running = node
            count += 1
            is_done = call() is not False
            if is_done and node is not None and (self.offset_ns or (node.compute_ns and kind)):
                node.busy_until_ns = due_ns + self.offset_ns + node.compute_ns
            self.offset_ns = 0
        self.running = None
        self.now_ns = max(self.now_ns, end_ns)
        self.events_run += count

    def run_as(self, node: ScheduledNode, call: Callable[[], Any]) -> Any:
        """Call something of a node outside of its events, such as a transition."""
        before, self.running = self.running, node
        offset_ns, self.offset_ns = self.offset_ns, 0
        try:
            return call()
        finally:
            self.running, self.offset_ns = before, offset_ns

    def sleep(self, seconds: float, where: str) -> None:
        """Let the running callback take time.

        Args:
            seconds: how long.
            where: the place of the call, for the note.
        """
        name = self.running.name if self.running else "a callback"
        self.note(
            ("sleep", where), f"{name} sleeps in {where}: counted as computing time of this node"
        )
        self.offset_ns += max(0, round(seconds * NS_PER_S))

    def note(self, key: object, text: str) -> None:
        """Keep a note, unless there is one with this key."""
        if key not in self._noted:
            self._noted.add(key)
            self.notes.append(f"{self.time_ns / NS_PER_S:.6f} s: {text}")

    def freeze(self, node: ScheduledNode) -> None:
        """Run nothing of a node until `thaw`."""
        node.is_frozen = True

    def thaw(self, node: ScheduledNode) -> None:
        """Run what a frozen node had to put off, and go on."""
        node.is_frozen = False
        held, node.held = node.held, []
        for due_ns, *rest in held:
            heapq.heappush(self._heap, (max(due_ns, self.now_ns), *rest))

    def clear(self) -> None:
        """Forget all events, and the nodes with them."""
        self._heap.clear()
        self.running = None

    def _fail_without_progress(self, event: Event) -> None:
        """Name the callbacks that call each other without end."""
        names: dict[str, None] = {}
        for _ in range(_TRACED):
            *_, node, call = event
            what = str(getattr(call, "__self__", "") or getattr(call, "func", call))
            if node is not None or what:
                names.setdefault(f"{node.name if node else '-'} ({_label_of(call)})")
            self.running = node
            call()
            self.offset_ns = 0
            if not self._heap:
                break
            event = heapq.heappop(self._heap)
        raise LockstepError(
            f"{MOST_AT_ONE_TIME:,} events at {self.now_ns / NS_PER_S:.6f} s without progress of "
            f"time: {', '.join(names)} cause each other; in a real run they would use a whole core"
        )


def _label_of(call: Callable[[], object]) -> str:
    """What an event is about: the topic, service or timer."""
    owner = getattr(call, "args", (None,))[0] if hasattr(call, "args") else None
    return str(getattr(owner, "label", None) or getattr(call, "__qualname__", type(call).__name__))
