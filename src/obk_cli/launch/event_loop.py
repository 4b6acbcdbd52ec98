"""The event loop of a run: the only place that waits for input events, and dispatches them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from queue import Empty
from typing import Protocol

from obk_cli.launch.events import EventPublisher, Hung, InputEvent
from obk_cli.launch.heartbeat import SLICE_S, AwakeClock, Heartbeat
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.stack_state import RunState, StackState
from obk_cli.launch.transitions import PendingRequests

__all__ = ["EventLoop", "Inbox", "Lifecycle", "Limits", "Processes", "RunContext"]


class Inbox(Protocol):
    """The input events in order; a `queue.SimpleQueue` is one."""

    def get(self, *, timeout: float | None) -> InputEvent:
        """The next event; raises `queue.Empty` after `timeout` [s]."""


class Processes(Protocol):
    """The interface to the operating system."""

    def start(self, unit: Unit) -> None:
        """Start a process; `ProcessStarted` or `ProcessEnded` follows."""

    def signal(self, process: str, number: int) -> None:
        """Send a signal to a process and all of its children."""

    def dump_stack(self, process: str) -> None:
        """Have a process that can write the stacks of its threads to its output."""

    def last_lines(self, process: str) -> tuple[str, ...]:
        """The last lines of a process's output."""


class Lifecycle(Protocol):
    """The interface to the nodes."""

    def watch(self, nodes: Iterable[str]) -> None:
        """Watch these nodes, again for restarted ones; `Ready` follows."""

    def request(self, node: str, transition: str) -> None:
        """Request a transition of a node; `Answered` follows."""

    def publishes_diagnostics(self, node: str) -> bool:
        """Whether a node publishes `/diagnostics`, so that it reports the rates that it has."""

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How long things may take [s]."""

    transition_s: float = 10.0
    start_s: float = 20.0
    grace_s: float = 3.0
    """Between two signals, each harder than the one before."""
    down_s: float = 3.0
    """For one transition on the way down."""
    answer_s: float = 2.0
    """For the answer to a question."""
    hurry_s: float = 0.5
    """Instead of `grace_s` after the second request to stop."""
    hang_s: float = 1.3
    """A node that has not answered for this long hangs; `inf`: never."""
    dump_s: float = 0.3
    """For writing a stack dump."""
    restarts: int = 5
    """Allowed within `restart_window_s`; one more crash stops the stack."""
    restart_window_s: float = 30.0


class EventLoop:
    """Waits on the inbox with deadlines.

    Each part of a run waits in `wait`; so whatever happens meanwhile is dispatched, wherever the
    run is. What follows from an event beyond that is left to the part that waits.
    """

    def __init__(
        self,
        *,
        inbox: Inbox,
        clock: AwakeClock,
        heartbeat: Heartbeat,
        dispatch: Callable[[InputEvent], None],
        check: Callable[[float], Hung | None],
    ) -> None:
        """Make a loop.

        Args:
            inbox: holds the input events.
            clock: monotonic time [s].
            heartbeat: knows when the next check is due.
            dispatch: takes note of each event.
            check: looks after the watched nodes at a time; gives the first one that hangs.
        """
        self.now = clock
        self._inbox = inbox
        self._heartbeat = heartbeat
        self._dispatch = dispatch
        self._check = check

    def wait(self, deadline: float | None) -> InputEvent | Hung | None:
        """The next event or hang, dispatched; None at the deadline (monotonic [s]).

        A hang counts as an event: it may be the only one if no node answers any more.
        """
        while True:
            now = self.now()
            if (hung := self._check(now)) is not None:
                return hung
            check = self._heartbeat.next_check(now)
            ends = [end for end in (deadline, check) if end is not None]
            left = min(SLICE_S, max(0.0, min(ends) - now)) if ends else None
            try:
                event = self._inbox.get(timeout=left)
            except Empty:
                self.now.waited(now, left)
                if deadline is not None and self.now() >= deadline:
                    return None
                continue
            self.now.waited(now, left)
            self._dispatch(event)
            return event


@dataclass(frozen=True, slots=True, kw_only=True)
class RunContext:
    """What the parts of a run share; the supervisor makes it and owns everything in it."""

    state: StackState
    run: RunState
    loop: EventLoop
    publisher: EventPublisher
    pending: PendingRequests
    heartbeat: Heartbeat
    processes: Processes
    lifecycle: Lifecycle
    limits: Limits
