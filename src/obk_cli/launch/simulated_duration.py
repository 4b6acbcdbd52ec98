"""Count simulated seconds on the clock page of a launch.

The simulator wakes the launcher at the step that reaches the end, at any simulation speed.
"""

import mmap
import os
import select
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from obelisk_spec.runtime_protocol import (
    CLOCK_EPOCH,
    CLOCK_FIRST_DUE,
    CLOCK_TIME,
    ClockDescriptors,
    clock_page_bytes,
)
from obk_cli.launch.events import OutputEvent, Phase

__all__ = ["SimulatedDuration", "counting"]

_NS_PER_S: Final = 1_000_000_000
_UP: Final = ("active", "following")
"""Phases after which the simulation may run."""


class SimulatedDuration:
    """Counts from the phase `active`; a reset of the simulation restarts the count."""

    def __init__(
        self, clock: ClockDescriptors, duration_s: float, on_over: Callable[[], None]
    ) -> None:
        """Map the page.

        Args:
            clock: the page, with a slot and a wake descriptor used only by this counter.
            duration_s: how long to count [simulated s].
            on_over: called once when time is up, in a separate thread.
        """
        size = clock_page_bytes(len(clock.wakes))
        self._words = memoryview(mmap.mmap(clock.page, size)).cast("q")
        self._wake_fd = clock.wakes[clock.own]
        self._own = CLOCK_FIRST_DUE + clock.own
        self._duration_ns = round(duration_s * _NS_PER_S)
        self._on_over = on_over
        self._is_closed = False
        self._epoch = 0
        self._counter: threading.Thread | None = None

    def on_event(self, event: OutputEvent) -> None:
        """Start counting when the stack is up."""
        if self._counter is None and isinstance(event, Phase) and event.name in _UP:
            self._start_count()
            self._counter = threading.Thread(target=self._count, name="sim duration", daemon=True)
            self._counter.start()

    def close(self) -> None:
        """Stop counting."""
        self._is_closed = True
        if self._counter is not None:
            os.eventfd_write(self._wake_fd, 1)
            self._counter.join()

    def _start_count(self) -> None:
        words = self._words
        self._epoch = words[CLOCK_EPOCH]
        words[self._own] = words[CLOCK_TIME] + self._duration_ns

    def _count(self) -> None:
        words = self._words
        poll = select.poll()
        poll.register(self._wake_fd, select.POLLIN)
        while not self._is_closed:
            if self._epoch != words[CLOCK_EPOCH]:
                self._start_count()
            if words[CLOCK_TIME] >= words[self._own]:
                self._on_over()
                return
            poll.poll()
            os.eventfd_read(self._wake_fd)


@contextmanager
def counting(
    clock: ClockDescriptors | None, duration_s: float | None, on_over: Callable[[], None]
) -> Iterator[Callable[[OutputEvent], None]]:
    """Yield a subscriber that counts; it does nothing without a clock or a duration."""
    if clock is None or duration_s is None:
        yield lambda _event: None
        return
    duration = SimulatedDuration(clock, duration_s, on_over)
    try:
        yield duration.on_event
    finally:
        duration.close()
