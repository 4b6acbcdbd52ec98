"""Handle the signals that terminate a program; Ctrl-C works even if a library swallows it.

Python drops exceptions raised in callbacks of C code, such as the one that releases an import lock;
extensions turn them into errors of their own. Ctrl-C is also handled in a program that was started
with SIGINT ignored, as shells do for programs in the background.
"""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, NoReturn

__all__ = [
    "accept_interrupt",
    "handle_end_signals",
    "hold_interrupts",
    "insist_on_interrupt",
    "is_interrupted",
    "release_interrupts",
    "until_interrupt",
]


_REPEAT_S: Final = 0.1
"""Period at which a lost KeyboardInterrupt is raised again [s]."""
_END_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def insist_on_interrupt() -> Iterator[None]:
    """Inside the `with` block, Ctrl-C raises KeyboardInterrupt; only from the main thread.

    The interrupt is raised again until it leaves the block or is accepted, but not while it is
    being handled, so cleanup is never interrupted.

    Raises:
        KeyboardInterrupt: also in place of an error that a library turned it into.
    """
    report = sys.unraisablehook

    def report_others(dropped: "sys.UnraisableHookArgs") -> None:
        if not issubclass(dropped.exc_type, KeyboardInterrupt):
            report(dropped)

    sys.unraisablehook = report_others
    before = signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    except Exception as error:
        if is_interrupted():
            raise KeyboardInterrupt from error
        raise
    finally:
        accept_interrupt()
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = report


def hold_interrupts() -> None:
    """Hold Ctrl-C back until `release_interrupts`, also in programs that this process starts.

    Python cannot handle Ctrl-C without a traceback while it imports the first modules of a program.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def release_interrupts() -> None:
    """Undo `hold_interrupts`, also of the program that started this one.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed in the meantime.
    """
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def until_interrupt() -> Iterator[None]:
    """Run a block until it is done or until Ctrl-C, which is a normal way to stop it."""
    try:
        yield
    except KeyboardInterrupt:
        accept_interrupt()


def accept_interrupt() -> None:
    """Do not raise the interrupt again; for commands that handle Ctrl-C themselves."""
    if is_interrupted():
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def is_interrupted() -> bool:
    """Whether Ctrl-C was pressed and not accepted yet."""
    return signal.getitimer(signal.ITIMER_REAL)[1] > 0.0


def _interrupt(_number: int, _frame: FrameType | None) -> NoReturn:
    signal.signal(signal.SIGALRM, _interrupt_again)
    signal.setitimer(signal.ITIMER_REAL, _REPEAT_S, _REPEAT_S)
    raise KeyboardInterrupt


def _interrupt_again(_number: int, _frame: FrameType | None) -> None:
    if not _is_being_handled():
        raise KeyboardInterrupt


def _is_being_handled() -> bool:
    """Whether an `except` or `finally` block entered because of KeyboardInterrupt is running."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


@contextmanager
def handle_end_signals(on_signal: Callable[[signal.Signals], None]) -> Iterator[None]:
    """Inside the `with` block, handle SIGINT, SIGTERM and SIGHUP; only from the main thread.

    SIGHUP stays ignored if it was ignored before, as with `nohup`. SIGINT is handled even then,
    because shells ignore it for programs that they start in the background.

    Args:
        on_signal: called with the signal; it interrupts the main thread anywhere.
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
