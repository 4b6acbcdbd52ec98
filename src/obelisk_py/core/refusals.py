"""Refused messages, counted by their reason and told at most once a second.

In: a sentence for each refusal, on any thread. Out: one for the log, with the counts.
"""

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final

__all__ = ["Refusals"]

REPORT_PERIOD_S: Final = 1.0


class Refusals:
    """What was refused and not told yet."""

    def __init__(self, what: str, monotonic_s: Callable[[], float]) -> None:
        """Begin with none.

        Args:
            what: how each report begins, "control refused".
            monotonic_s: clock for the rate of reports [s].
        """
        self._what = what
        self._monotonic_s = monotonic_s
        self._lock = threading.Lock()
        self._untold: Counter[str] = Counter()
        self._total = 0
        self._last_report_s = -float("inf")

    def add(self, reason: str) -> None:
        """Count one."""
        with self._lock:
            self._untold[reason] += 1
            self._total += 1

    def report(self) -> str | None:
        """A sentence about all that no log line has told yet, at most once a second."""
        now_s = self._monotonic_s()
        with self._lock:
            if not self._untold or now_s - self._last_report_s < REPORT_PERIOD_S:
                return None
            self._last_report_s = now_s
            reasons = "; ".join(f"{reason} ({count}x)" for reason, count in self._untold.items())
            self._untold.clear()
            return f"{self._what}: {reasons}; {self._total} since the start"
