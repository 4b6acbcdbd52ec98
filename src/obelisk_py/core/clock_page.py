"""Share simulated time between the processes of a launch through a page of shared memory.

The simulator writes the time after each step. Reading it costs a process no message and no system
call. Each process also writes the due time of its next timer into its own word of the page. The
simulator signals the process's eventfd at the step that reaches this time, so a process wakes up
only when one of its timers is due, not at every step.

Each field is an aligned 8-byte word that is written in a single store, so readers never see a
partial value and need no lock. If a process writes a due time while a step ends, the simulator
sees it at the next step at the latest. The process checks the time again after the write.
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
    """One process's view of the clock page."""

    def __init__(self, descriptors: ClockDescriptors) -> None:
        """Map the page.

        Args:
            descriptors: must stay open until `close`.
        """
        self._words = _mapped(descriptors)
        self._own = CLOCK_FIRST_DUE + descriptors.own
        self.wake_fd = descriptors.wakes[descriptors.own]
        """Signaled when the due time of this process is reached, and after a jump back."""
        self.followers: weakref.WeakSet[Any] = weakref.WeakSet()
        """The clocks of this process that follow the page."""
        self.set_due(NEVER_NS)

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]; 0 before the first step."""
        return self._words[CLOCK_TIME]

    @property
    def epoch(self) -> int:
        """Number of times that the clock jumped back."""
        return self._words[CLOCK_EPOCH]

    def set_due(self, due_ns: int) -> None:
        """Request a wake-up at this time [ns], which may already have passed."""
        self._words[self._own] = due_ns

    def close(self) -> None:
        """Cancel the requested wake-up."""
        self.set_due(NEVER_NS)


class ClockWriter:
    """Sets the time and wakes the processes whose timers are due."""

    def __init__(self, descriptors: ClockDescriptors) -> None:
        """Map the page.

        Args:
            descriptors: must stay open while the writer is used.
        """
        self._words = words = _mapped(descriptors)
        self._wakes = descriptors.wakes
        self._dues = words[CLOCK_FIRST_DUE:]
        self._signalled = [0] * len(self._wakes)
        """The last due time signaled to each process; each one is signaled only once."""

    def advance(self, time_ns: int) -> None:
        """Set the time [ns] after a step."""
        self._words[CLOCK_TIME] = time_ns
        signalled = self._signalled
        for place, due_ns in enumerate(self._dues.tolist()):
            if due_ns <= time_ns and due_ns != signalled[place]:
                signalled[place] = due_ns
                os.eventfd_write(self._wakes[place], 1)

    def restart(self, time_ns: int) -> None:
        """Set the time [ns] after a reset; if it jumps back, wake every process."""
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
    """Open the clock page inherited from the launcher; None if it passed none."""
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
    """Open the simulator's writing end of that page; None if the launcher passed none."""
    descriptors = _inherited()
    return None if descriptors is None else ClockWriter(descriptors)


def _mapped(descriptors: ClockDescriptors) -> "memoryview[int]":
    size = clock_page_bytes(len(descriptors.wakes))
    return memoryview(mmap.mmap(descriptors.page, size)).cast("q")


def _inherited() -> ClockDescriptors | None:
    """The descriptors that `CLOCK_VARIABLE` lists; None if they are not open in this process.

    A child process of a node inherits the variable, but not the descriptors.
    """
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
