"""What a rehearsal does to a process: kill it, freeze it, thaw it.

Takes numbers of processes; one that is gone already is no fault.
"""

from collections.abc import Iterator
from contextlib import suppress

import psutil

__all__ = ["freeze", "kill", "thaw"]


def kill(pid: int) -> None:
    """End a process as the kernel does when memory runs out; not those that it started."""
    with suppress(psutil.Error):
        psutil.Process(pid).kill()


def freeze(pid: int) -> None:
    """Stop a process and all that it started: a program behind a script freezes with it."""
    for process in _family(pid):
        with suppress(psutil.Error):
            process.suspend()


def thaw(pid: int) -> None:
    """Have a frozen process go on, and all that it started."""
    for process in _family(pid):
        with suppress(psutil.Error):
            process.resume()


def _family(pid: int) -> Iterator[psutil.Process]:
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        yield process
        yield from process.children(recursive=True)
