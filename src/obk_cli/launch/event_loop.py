"""The event loop of a run: the only place that waits for input events, and dispatches them."""

from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty

from obk_cli.launch.events import EventPublisher, Hung, InputEvent
from obk_cli.launch.heartbeat import SLICE_S, AwakeClock, Heartbeat
from obk_cli.launch.interfaces import Inbox, Lifecycle, Limits, Processes
from obk_cli.launch.stack_state import RunState, StackState
from obk_cli.launch.transitions import PendingRequests

__all__ = ["EventLoop", "RunContext"]


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
