"""A thread that sends what waits for a socket, once its subscription reads again.

It is started when a socket is full for the first time, and sleeps until then and afterwards, so
publishers need no executor and the usual case no thread.
"""

import functools
import select
import threading
from contextlib import suppress
from typing import Protocol

__all__ = ["Flusher", "flusher_of"]


class _Waiting(Protocol):
    def fileno(self) -> int: ...

    def flush(self) -> bool:
        """Send; true if something is left."""


class Flusher:
    """The thread, and the connections that it waits for."""

    def __init__(self) -> None:
        """Start the thread."""
        self._epoll = select.epoll()
        self._waiting: dict[int, _Waiting] = {}
        threading.Thread(target=self._run, name="local transport", daemon=True).start()

    def watch(self, connection: _Waiting) -> None:
        """Flush a connection when its socket takes packets again; from any thread."""
        fd = connection.fileno()
        self._waiting[fd] = connection
        flags = select.EPOLLOUT | select.EPOLLONESHOT
        try:
            self._epoll.register(fd, flags)
        except FileExistsError:
            self._epoll.modify(fd, flags)

    def _run(self) -> None:
        while True:
            for fd, _ in self._epoll.poll():
                connection = self._waiting.pop(fd, None)
                if connection is not None and connection.flush():
                    with suppress(OSError, ValueError):  # closed meanwhile
                        self.watch(connection)


@functools.cache
def flusher_of(_process: int) -> Flusher:
    """The flusher of this process; a forked process has one of its own."""
    return Flusher()
