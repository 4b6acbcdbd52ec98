"""Whether anybody listens to a topic, so that nothing is cast, drawn or sent for nobody.

In: what counts a publisher's subscriptions, a clock. Out: yes or no, which may be old by less time
than it takes two nodes to find each other.
"""

import time
from collections.abc import Callable
from typing import Final

__all__ = ["Audience"]

_ASK_NS: Final = 5_000_000
"""Wall time for which an answer holds [ns]: the middleware is slow to ask, for each sample."""


class Audience:
    """The subscriptions of one publisher."""

    def __init__(
        self, count: Callable[[], int], now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Ask by `count`, at times of the clock `now_ns` [ns]."""
        self._count = count
        self._now_ns = now_ns
        self._ask_at_ns: float = -float("inf")
        self._is_there = False

    def is_there(self) -> bool:
        """Whether somebody listens."""
        now_ns = self._now_ns()
        if now_ns >= self._ask_at_ns:
            self._ask_at_ns = now_ns + _ASK_NS
            self._is_there = self._count() > 0
        return self._is_there
