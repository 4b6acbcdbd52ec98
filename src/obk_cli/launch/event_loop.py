"""The event loop of a run: the only place that waits for input events and dispatches them."""

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
    """The input events in order, such as a `queue.SimpleQueue`."""

    def get(self, *, timeout: float | None) -> InputEvent:
        """The next event; raises `queue.Empty` after `timeout` [s]."""


class Processes(Protocol):
    """The interface to the operating system."""

    def start(self, unit: Unit) -> None:
        """Start a process; `ProcessStarted` or `ProcessEnded` follows."""

    def signal(self, process: str, number: int) -> None:
        """Send a signal to a process and all of its children."""

    def dump_stack(self, process: str) -> None:
        """Make a process write the stacks of its threads to its output, if it supports that."""

    def last_lines(self, process: str) -> tuple[str, ...]:
        """The last lines of a process's output."""

    def wait_for_output(self, processes: Iterable[str]) -> None:
        """Wait until the output of processes that have ended was read."""


class Lifecycle(Protocol):
    """The interface to the nodes."""

    def watch(self, nodes: Iterable[str]) -> None:
        """Watch these nodes; call again for restarted ones. `Ready` follows."""

    def request(self, node: str, transition: str) -> None:
        """Request a transition of a node; `Answered` follows."""

    def publishes_diagnostics(self, node: str) -> bool:
        """Whether a node publishes `/diagnostics`, and therefore reports its own rates."""

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Time limits of a run [s]."""

    transition_s: float = 10.0
    start_s: float = 20.0
    grace_s: float = 3.0
    """Wait between two signals, each stronger than the one before."""
    down_s: float = 3.0
    """Limit for one transition during shutdown."""
    answer_s: float = 2.0
    """Limit for the answer to a query."""
    hurry_s: float = 0.5
    """Replaces `grace_s` after the second request to stop."""
    hang_s: float = 1.3
    """A node that has not answered for this time hangs; `inf`: never."""
    dump_s: float = 0.3
    """Limit for writing a stack dump."""
    restarts: int = 5
    """Maximum number within `restart_window_s`; one more crash stops the stack."""
    restart_window_s: float = 30.0


class EventLoop:
    """Waits on the inbox with deadlines.

    All parts of a run wait in `wait`, which dispatches every event that arrives meanwhile. The part
    that waits decides what else follows from an event.
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
        """Create a loop.

        Args:
            inbox: holds the input events.
            clock: monotonic time [s].
            heartbeat: returns the time of the next check.
            dispatch: handles each event.
            check: checks the watched nodes at a time; returns the first one that hangs.
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
    """State that the parts of a run share; the supervisor creates it and owns everything in it."""

    state: StackState
    run: RunState
    loop: EventLoop
    publisher: EventPublisher
    pending: PendingRequests
    heartbeat: Heartbeat
    processes: Processes
    lifecycle: Lifecycle
    limits: Limits
