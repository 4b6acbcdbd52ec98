"""What surrounds a node: DDS, the system's clocks and threads, or a lock-step run in their place.

A node asks its surroundings for timers, publishers and threads when it creates them, and hands over
what rclpy has created. Nothing is asked per message or tick, so a normal run costs no more.
"""

import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Any, Protocol

from rclpy.context import Context

from obelisk_py.core.command_watchdog import WatchdogThread
from obelisk_py.core.intra_process import IntraProcessPublisher
from obelisk_py.core.shared_clock import (
    ClockFeed,
    SharedClock,
    is_of_time_source,
    page_to_follow,
    share_timer,
)
from obelisk_py.core.timer_phase import LoopStage, start_in_step

__all__ = ["SteppedRobot", "Surroundings", "Watchdog", "current_surroundings", "new_nodes_are_in"]

Create = Callable[..., Any]
"""rclpy's own method of a node."""


class Watchdog(Protocol):
    """Checks the age of commands; see `WatchdogThread`."""

    def start(self) -> None:
        """Start to check."""

    def wake(self) -> None:
        """Check the deadline again, after there was none."""

    def stop(self, timeout_s: float) -> bool:
        """Stop; false if it still runs after `timeout_s` [s]."""


class SteppedRobot(Protocol):
    """A simulated robot whose steps may be taken one by one."""

    def step_once(self) -> None:
        """Take the next step and publish what is due after it, unless the robot is paused."""

    def next_step_ns(self) -> int:
        """Simulated time from the present step to the next one [ns]."""


class Surroundings:
    """DDS, the clocks and the threads of the system."""

    is_lockstep: bool = False
    """Whether time is simulated for the whole process: every rate is kept, nothing is late."""
    noise_seed: int = 0
    """Changes the noise of simulated sensors; 0: the noise is as the config has it."""

    def __init__(self) -> None:
        """Take the clock page that new nodes of this process follow."""
        self._clock_page = page_to_follow()

    def construction(self, _node: Any) -> AbstractContextManager[None]:
        """Entered while rclpy constructs a node."""
        return nullcontext()

    def publisher_class(self, context: Context, *, has_lifecycle: bool) -> Any | None:
        """The class of a new publisher; None: rclpy's."""
        return functools.partial(IntraProcessPublisher, context) if has_lifecycle else None

    def create_timer(self, node: Any, create: Create, *args: Any, **kwargs: Any) -> Any:
        """A timer of a node."""
        clock = kwargs.get("clock") or node.get_clock()
        if isinstance(clock, SharedClock):
            clock.sync()
        timer = create(*args, **kwargs)
        share_timer(timer)
        return timer

    def start_timer(self, timer: Any, stage: LoopStage) -> None:
        """Start a stopped timer of a node that is at `stage` of the control loop."""
        start_in_step(timer, stage)

    def create_rate(self, _node: Any, create: Create, *args: Any, **kwargs: Any) -> Any:
        """A rate of a node."""
        return create(*args, **kwargs)

    def clock_feed(self, node: Any, callback: Any) -> Any | None:
        """What replaces the subscription of a node's time source to `/clock`; None: nothing."""
        if self._clock_page is None or not is_of_time_source(callback):
            return None
        return ClockFeed(node.get_clock(), self._clock_page)

    def adopt(self, node: Any, entity: Any) -> None:
        """Take over a publisher or subscription, service, client, waitable, guard condition."""
        if isinstance(entity, IntraProcessPublisher):
            entity.attach(node)

    def release(self, entity: Any) -> None:
        """Let go of a subscription or service before it is destroyed."""

    def make_thread(self, _node: Any, target: Callable[[], None], name: str) -> threading.Thread:
        """A thread of a node, not started; it does not keep the process alive."""
        return threading.Thread(target=target, name=name, daemon=True)

    def make_watchdog(
        self, _node: Any, deadline_s: Callable[[], float | None], check: Callable[[], None]
    ) -> Watchdog:
        """A watchdog that is not started; the arguments are those of `WatchdogThread`."""
        return WatchdogThread(deadline_s, check)

    def drive(self, _node: Any, _robot: SteppedRobot) -> threading.Thread | None:
        """Take the steps of a simulated robot; None: its own thread takes them."""
        return None


_surroundings: ContextVar[Surroundings | None] = ContextVar("surroundings", default=None)


@contextmanager
def new_nodes_are_in(surroundings: Surroundings) -> Iterator[None]:
    """While entered, new nodes have these surroundings."""
    token = _surroundings.set(surroundings)
    try:
        yield
    finally:
        _surroundings.reset(token)


def current_surroundings() -> Surroundings:
    """The surroundings of a node that is made now."""
    return _surroundings.get() or Surroundings()
