"""Locks of the nodes' code: a callback or guest thread waits for one in simulated time.

A thread may sleep while it holds a lock, and its next turn comes only when the scheduler runs.
Therefore a callback must not block in the lock itself, because that would block the scheduler.
"""

import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

__all__ = ["NodeLock", "NodeRLock", "lock_class"]


class NodeLock:
    """Replaces `threading.Lock`."""

    def __init__(self, real: Any, wait: "Callable[[NodeLock, float], bool]") -> None:
        """Wrap a lock.

        Args:
            real: the lock.
            wait: called with this lock and a timeout [s], -1 for none, if the lock is held; it
                acquires the lock and returns True, or returns False after the timeout.
        """
        self.real = real
        self.holder: int | None = None
        """Id of the thread that acquired it most recently."""
        self._wait = wait

    def __repr__(self) -> str:
        return repr(self.real)

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def take(self) -> bool:
        """Acquire the lock if it is free."""
        is_taken: bool = self.real.acquire(blocking=False)
        return is_taken

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Acquire the lock, as `threading.Lock.acquire` does."""
        is_acquired = self.take() or (blocking and self._wait(self, timeout))
        if is_acquired:
            self.holder = threading.get_ident()
        return is_acquired

    def release(self) -> None:
        """Release the lock."""
        self.real.release()

    def locked(self) -> bool:
        """Whether a thread holds the lock."""
        is_locked: bool = self.real.locked()
        return is_locked


class NodeRLock(NodeLock):
    """Replaces `threading.RLock`."""

    # `threading.Condition` calls these methods.

    def _is_owned(self) -> bool:
        is_owned: bool = self.real._is_owned()
        return is_owned

    def _release_save(self) -> int:
        count, _ = self.real._release_save()
        return int(count)

    def _acquire_restore(self, count: int) -> None:
        for _ in range(count):
            self.acquire()


def lock_class(
    real: Callable[[], Any],
    kind: type[NodeLock],
    is_of_node: Callable[[FrameType], bool],
    wait: Callable[[NodeLock, float], bool],
) -> type[Any]:
    """Return what replaces `threading.Lock` or `threading.RLock`.

    Args:
        real: creates a real lock.
        kind: the class of the nodes' locks.
        is_of_node: whether the code in a frame belongs to a node; other code gets real locks.
        wait: see `NodeLock`.
    """
    of_condition = threading.Condition.__init__.__code__

    class Lock:
        """A class, because annotations may contain `Lock | None`."""

        def __new__(cls) -> Any:
            caller: FrameType = sys._getframe(1)
            if caller.f_code is of_condition and caller.f_back is not None:
                caller = caller.f_back  # the default lock of a condition
            return kind(real(), wait) if is_of_node(caller) else real()

    return Lock
