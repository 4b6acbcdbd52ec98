"""Wait for asynchronous conditions."""

import time
from collections.abc import Callable
from typing import Final

__all__ = ["DEADLINE_S", "eventually"]

DEADLINE_S: Final = 60.0
"""Timeout for anything, because a busy machine is ten times as slow as an idle one."""


def eventually(
    condition: Callable[[], object],
    what: str,
    *,
    seen: Callable[[], str] = str,
    deadline_s: float = DEADLINE_S,
    pause_s: float = 0.01,
) -> None:
    """Wait until a condition is true; fail the test on timeout, and show the last value."""
    end = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end, f"never came: {what}\n{seen()}"
        time.sleep(pause_s)
