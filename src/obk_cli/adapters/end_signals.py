"""The signals that ask a program for its end in order."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

__all__ = ["end_signals_heard"]

_END_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def end_signals_heard(hear: Callable[[signal.Signals], None]) -> Iterator[None]:
    """While entered, SIGINT, SIGTERM and SIGHUP are heard; only from the main thread.

    Where SIGHUP was ignored before, as `nohup` has it, a terminal that closes ends nothing. SIGINT
    is heard all the same: shells ignore it for whatever they start in the background.

    Args:
        hear: takes a signal, in whatever the main thread is doing.
    """

    def handle(number: int, _frame: FrameType | None) -> None:
        hear(signal.Signals(number))

    is_ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    heard = (number for number in _END_SIGNALS if number != signal.SIGHUP or not is_ignored)
    before = {number: signal.signal(number, handle) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
