"""SIGINT and SIGTERM: the first requests a clean shutdown, the second ends the process.

The interpreter runs a signal handler only when the main thread is back in Python, which an executor
that waits in C++ never is; the wake-up descriptor is written at once.
Source: https://docs.python.org/3/library/signal.html#signal.set_wakeup_fd
"""

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Self

__all__ = ["ShutdownSignals"]

SHUTDOWN_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class ShutdownSignals:
    """While entered, call back from a thread at the first signal; the second ends the process."""

    def __init__(self) -> None:
        self._on_signal: Callable[[], object] | None = None
        self._seen = 0
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        self._read_fd, self._write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        os.set_blocking(self._read_fd, True)
        self._old_fd = signal.set_wakeup_fd(self._write_fd, warn_on_full_buffer=False)
        self._old = {number: signal.signal(number, _ignore) for number in SHUTDOWN_SIGNALS}
        self._thread = threading.Thread(target=self._watch, name="end signals", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_fd)
        os.close(self._write_fd)
        self._thread.join()
        os.close(self._read_fd)

    def call_back(self, on_signal: Callable[[], object]) -> None:
        """Call back at the first signal, or now if it has come already."""
        with self._lock:
            self._on_signal = on_signal
            if self._seen:
                on_signal()

    def _watch(self) -> None:
        while number := os.read(self._read_fd, 1):
            if number[0] not in SHUTDOWN_SIGNALS:
                continue
            with self._lock:
                self._seen += 1
                if self._seen > 1:
                    os._exit(128 + number[0])
                if self._on_signal is not None:
                    self._on_signal()


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing: the thread is notified by the wake-up descriptor."""
