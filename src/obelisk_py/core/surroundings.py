"""Provide a node's environment: DDS and the system's clocks and threads, or a lockstep run.

A node asks its surroundings to create its timers, publishers and threads, and registers with them
the entities that rclpy has created. There are no calls per message or tick, so a normal run has no
overhead.
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
"""The method of rclpy's node that creates the entity."""


class Watchdog(Protocol):
    """Checks the age of commands; see `WatchdogThread`."""

    def start(self) -> None:
        """Start checking."""

    def wake(self) -> None:
        """Read the deadline again; call this when a deadline is set and there was none before."""

    def stop(self, timeout_s: float) -> bool:
        """Stop; false if it is still running after `timeout_s` [s]."""


class SteppedRobot(Protocol):
    """A simulated robot that another thread or a scheduler can step."""

    def step_once(self) -> None:
        """Take the next step and publish what is due, unless the robot is paused."""

    def next_step_ns(self) -> int:
        """Simulated time from the current step to the next one [ns]."""


class Surroundings:
    """DDS, and the clocks and threads of the system."""

    is_lockstep: bool = False
    """Whether the whole process runs in simulated time, so that every rate is exact."""
    noise_seed: int = 0
    """Changes the noise of simulated sensors; 0 keeps the noise as configured."""

    def __init__(self) -> None:
        """Use the clock page that new nodes of this process follow."""
        self._clock_page = page_to_follow()

    def construction(self, _node: Any) -> AbstractContextManager[None]:
        """Return a context manager that is active while rclpy constructs a node."""
        return nullcontext()

    def publisher_class(self, context: Context, *, has_lifecycle: bool) -> Any | None:
        """Return the class of a new publisher; None for rclpy's."""
        return functools.partial(IntraProcessPublisher, context) if has_lifecycle else None

    def create_timer(self, node: Any, create: Create, *args: Any, **kwargs: Any) -> Any:
        """Create a timer."""
        clock = kwargs.get("clock") or node.get_clock()
        if isinstance(clock, SharedClock):
            clock.sync()
        timer = create(*args, **kwargs)
        share_timer(timer)
        return timer

    def start_timer(self, timer: Any, stage: LoopStage) -> None:
        """Start a stopped timer; `stage` is its node's stage in the control loop."""
        start_in_step(timer, stage)

    def create_rate(self, _node: Any, create: Create, *args: Any, **kwargs: Any) -> Any:
        """Create a rate."""
        return create(*args, **kwargs)

    def clock_feed(self, node: Any, callback: Any) -> Any | None:
        """Return the replacement for the time source's `/clock` subscription; None to keep it."""
        if self._clock_page is None or not is_of_time_source(callback):
            return None
        return ClockFeed(node.get_clock(), self._clock_page)

    def adopt(self, node: Any, entity: Any) -> None:
        """Register a new publisher, subscription, service, client, waitable or guard condition."""
        if isinstance(entity, IntraProcessPublisher):
            entity.attach(node)

    def release(self, entity: Any) -> None:
        """Unregister a subscription or service before it is destroyed."""

    def make_thread(self, _node: Any, target: Callable[[], None], name: str) -> threading.Thread:
        """Create a daemon thread for a node without starting it."""
        return threading.Thread(target=target, name=name, daemon=True)

    def make_watchdog(
        self, _node: Any, deadline_s: Callable[[], float | None], check: Callable[[], None]
    ) -> Watchdog:
        """Create a watchdog without starting it; for the arguments see `WatchdogThread`."""
        return WatchdogThread(deadline_s, check)

    def drive(self, _node: Any, _robot: SteppedRobot) -> threading.Thread | None:
        """Return the thread that steps a simulated robot; None if the robot starts its own."""
        return None


_surroundings: ContextVar[Surroundings | None] = ContextVar("surroundings", default=None)


@contextmanager
def new_nodes_are_in(surroundings: Surroundings) -> Iterator[None]:
    """Give new nodes these surroundings inside the `with` block."""
    token = _surroundings.set(surroundings)
    try:
        yield
    finally:
        _surroundings.reset(token)


def current_surroundings() -> Surroundings:
    """Return the surroundings for a node that is being created."""
    return _surroundings.get() or Surroundings()
