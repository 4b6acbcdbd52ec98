"""Clocks: monotonic for measuring and waiting, wall-clock time for display."""

import time
from datetime import datetime

__all__ = ["local_time", "monotonic_s", "wall_s"]


def monotonic_s() -> float:
    """A clock that never jumps [s]."""
    return time.monotonic()


def wall_s() -> float:
    """The current time [s since 1970, UTC]."""
    return time.time()


def local_time() -> datetime:
    """The current time in the user's time zone."""
    return datetime.now()
