"""Refused messages, counted by their reason and told at most once a second.

In: a sentence for each refusal, on any thread. Out: one for the log, with the counts; where nothing
but refusals comes it says so, and comes rarely.
"""

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final, NamedTuple

__all__ = ["REFUSED_ON_END", "Refusals", "Report"]

REPORT_PERIOD_S: Final = 1.0
LASTING_S: Final = 1.0
"""Refusals on end for so long are no slip any more [s]."""
LASTING_PERIOD_S: Final = 10.0
"""From one report to the next, once that has been told [s]."""
MOST_REASONS: Final = 8
"""That a report tells; those beyond, as of a number that grows, are counted only."""
REFUSED_ON_END: Final = (
    "nothing else has come for {lasting_s:.1f} s, so the robot has no commands; "
    "`obk topic echo` shows what the controller sends"
)
"""What is said of control messages that are all refused."""


class Report(NamedTuple):
    """A sentence for the log."""

    text: str
    is_lasting: bool
    """Whether nothing was accepted for a while: an error."""


class Refusals:
    """What was refused and not told yet."""

    def __init__(
        self, what: str, monotonic_s: Callable[[], float], on_end: str | None = None
    ) -> None:
        """Begin with none.

        Args:
            what: how each report begins, "control refused".
            monotonic_s: clock for the rate of reports [s].
            on_end: what to say where nothing is accepted for a while, with `{lasting_s}`;
                None: nothing.
        """
        self._what = what
        self._monotonic_s = monotonic_s
        self._on_end = on_end
        self._lock = threading.Lock()
        self._untold: Counter[str] = Counter()
        self._others = 0
        self._total = 0
        self._next_report_s = -float("inf")
        self._since_s: float | None = None

    def add(self, reason: str) -> None:
        """Count one."""
        with self._lock:
            if reason in self._untold or len(self._untold) < MOST_REASONS:
                self._untold[reason] += 1
            else:
                self._others += 1
            self._total += 1
            if self._since_s is None:
                self._since_s = self._monotonic_s()

    def accept(self) -> None:
        """Note that one was accepted, or that counting on end begins anew."""
        self._since_s = None

    def report(self) -> Report | None:
        """A sentence about all that no log line has told yet, at most once a second."""
        now_s = self._monotonic_s()
        with self._lock:
            if not self._untold or now_s < self._next_report_s:
                return None
            since_s = self._since_s
            lasting_s = 0.0 if since_s is None else now_s - since_s
            is_lasting = self._on_end is not None and lasting_s >= LASTING_S
            self._next_report_s = now_s + (LASTING_PERIOD_S if is_lasting else REPORT_PERIOD_S)
            reasons = "; ".join(f"{reason} ({count}x)" for reason, count in self._untold.items())
            if self._others:
                reasons = f"{reasons}; for further reasons ({self._others}x)"
            self._untold.clear()
            self._others = 0
            text = f"{self._what}: {reasons}; {self._total} since the start"
            if self._on_end is not None and is_lasting:
                text = f"{text}; {self._on_end.format(lasting_s=lasting_s)}"
            return Report(text, is_lasting)
