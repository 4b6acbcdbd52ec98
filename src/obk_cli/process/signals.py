"""Handle the signals that end a program, and signal processes for fault injection."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Final

import psutil

__all__ = ["freeze", "handle_end_signals", "kill", "thaw"]

_END_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handle_end_signals(on_signal: Callable[[signal.Signals], None]) -> Iterator[None]:
    """While entered, handle SIGINT, SIGTERM and SIGHUP; only from the main thread.

    SIGHUP stays ignored if it was ignored before, as by `nohup`. SIGINT is handled even then,
    because shells ignore it for programs that they start in the background.

    Args:
        on_signal: takes a signal; it interrupts the main thread anywhere.
    """

    def handle(number: int, _frame: FrameType | None) -> None:
        on_signal(signal.Signals(number))

    is_ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    handled = (number for number in _END_SIGNALS if number != signal.SIGHUP or not is_ignored)
    before = {number: signal.signal(number, handle) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
    """Resume a frozen process and all that it started."""
    for process in _family(pid):
        with suppress(psutil.Error):
            process.resume()


def _family(pid: int) -> Iterator[psutil.Process]:
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        yield process
        yield from process.children(recursive=True)
