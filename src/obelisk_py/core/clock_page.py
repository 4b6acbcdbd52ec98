"""Share simulated time between the processes of a launch: one page of memory, a wake-up for each.

The simulator writes the time after each step. A process reads it when it asks for the time, which
costs no message and no system call. For its timers it writes into its word of the page when the
next one is due; the simulator signals the process's eventfd at the step that reaches this time. So
a process wakes up when one of its timers is due, and not at every step.

Each field is an aligned word of 8 bytes that one store writes, so a reader never sees half of one
and needs no lock. A due time that is written while a step ends is seen at the next step at the
latest, and the process that writes one checks the time afterwards.
"""

import mmap
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from obelisk_spec.runtime_protocol import (
    CLOCK_EPOCH,
    CLOCK_FIRST_DUE,
    CLOCK_PAGE,
    CLOCK_TIME,
    CLOCK_VARIABLE,
    ClockDescriptors,
    clock_page_bytes,
    parse_clock,
)

__all__ = ["NEVER_NS", "ClockPage", "ClockWriter", "open_clock_page", "open_clock_writer"]

NEVER_NS: Final = (1 << 63) - 1
"""Due time of a process without timers [ns]."""


class ClockPage:
    """The clock page, as one process sees it."""

    def __init__(self, descriptors: ClockDescriptors) -> None:
        """Map the page.

        Args:
            descriptors: stay open until `close`.
        """
        self._words = _mapped(descriptors)
        self._own = CLOCK_FIRST_DUE + descriptors.own
        self.wake_fd = descriptors.wakes[descriptors.own]
        """Signalled when the due time of this process is reached, and after a jump back."""
        self.followers: weakref.WeakSet[Any] = weakref.WeakSet()
        """The clocks of this process that follow the page."""
        self.set_due(NEVER_NS)

    @property
    def time_ns(self) -> int:
        """The simulated time [ns]; 0 before the first step."""
        return self._words[CLOCK_TIME]

    @property
    def epoch(self) -> int:
        """How often the time was set back."""
        return self._words[CLOCK_EPOCH]

    def set_due(self, due_ns: int) -> None:
        """Ask to be woken at this time [ns]; the time may have come already."""
        self._words[self._own] = due_ns

    def close(self) -> None:
        """Ask for no further wake-up."""
        self.set_due(NEVER_NS)


class ClockWriter:
    """Sets the time, and wakes the processes whose timers are due."""

    def __init__(self, descriptors: ClockDescriptors) -> None:
        """Map the page.

        Args:
            descriptors: stay open while the writer is used.
        """
        self._words = words = _mapped(descriptors)
        self._wakes = descriptors.wakes
        self._dues = words[CLOCK_FIRST_DUE:]
        self._signalled = [0] * len(self._wakes)
        """The due times for which the processes were signalled last: once for each of them."""

    def advance(self, time_ns: int) -> None:
        """Set the time [ns] after steps."""
        self._words[CLOCK_TIME] = time_ns
        signalled = self._signalled
        for place, due_ns in enumerate(self._dues.tolist()):
            if due_ns <= time_ns and due_ns != signalled[place]:
                signalled[place] = due_ns
                os.eventfd_write(self._wakes[place], 1)

    def restart(self, time_ns: int) -> None:
        """Set the time [ns] of a reset; every process is woken if it jumps back."""
        if time_ns >= self._words[CLOCK_TIME]:
            self.advance(time_ns)
            return
        self._words[CLOCK_TIME] = time_ns
        self._words[CLOCK_EPOCH] += 1
        self._signalled = [0] * len(self._wakes)
        for wake_fd in self._wakes:
            os.eventfd_write(wake_fd, 1)


@contextmanager
def open_clock_page() -> Iterator[ClockPage | None]:
    """The clock page that the launcher gave to this process; None if it gave none."""
    descriptors = _inherited()
    if descriptors is None:
        yield None
        return
    page = ClockPage(descriptors)
    try:
        yield page
    finally:
        page.close()


def open_clock_writer() -> ClockWriter | None:
    """The writing end of that page, for the simulator."""
    descriptors = _inherited()
    return None if descriptors is None else ClockWriter(descriptors)


def _mapped(descriptors: ClockDescriptors) -> "memoryview[int]":
    size = clock_page_bytes(len(descriptors.wakes))
    return memoryview(mmap.mmap(descriptors.page, size)).cast("q")


def _inherited() -> ClockDescriptors | None:
    """The descriptors of `CLOCK_VARIABLE`; a child of a node has the variable only."""
    descriptors = parse_clock(os.environ.get(CLOCK_VARIABLE, ""))
    if descriptors is None:
        return None
    everything = (descriptors.page, *descriptors.wakes)
    try:
        page, *wakes = (Path(f"/proc/self/fd/{fd}").readlink().name for fd in everything)
    except OSError:
        return None
    if CLOCK_PAGE not in page or not all("eventfd" in wake for wake in wakes):
        return None
    for fd in everything:
        os.set_inheritable(fd, False)
    return descriptors
