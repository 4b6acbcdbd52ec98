"""Wake the thread of a timer early, so that the timer's callback starts on time.

A sleeping thread does not run at once when its kernel timer expires, but 25 to 100 us later on the
virtual machine of the benchmarks. The kernel timer is therefore set earlier, and the thread
busy-waits until the timer is due. The lead follows the machine's delays, which stay similar from
one wake-up to the next.
"""

import time
from typing import Final

__all__ = ["EarlyWakeup"]

_EARLY_NS: Final = 6_000
"""How early the thread is to run on average: a compromise between punctuality and CPU time."""
_LATEST_NS: Final = 10_000
"""Later wake-ups count as this late. Otherwise, busy-waits would be long if delays vary a lot."""
_LONGEST_LEAD_NS: Final = 100_000
_LEADS_PER_PERIOD: Final = 10
"""The lead is at most the period divided by this number."""
_SMOOTHING: Final = 8
"""Each wake-up changes the lead by its distance from `_EARLY_NS`, divided by this number."""
_TOLERANCE_NS: Final = 4_000
"""A smaller change of the lead is not worth a system call."""


class EarlyWakeup:
    """How early one kernel timer expires."""

    def __init__(self) -> None:
        """Start without a lead."""
        self.lead_ns = 0
        """The lead with which the kernel timer was set."""
        self._wanted_ns = 0
        self._longest_ns = 0

    @property
    def is_outdated(self) -> bool:
        """Whether the kernel timer should be set again."""
        return abs(self._wanted_ns - self.lead_ns) > _TOLERANCE_NS

    def renew(self, period_ns: int) -> int:
        """Return the lead for a kernel timer with this period; both in ns."""
        self._longest_ns = min(_LONGEST_LEAD_NS, period_ns // _LEADS_PER_PERIOD)
        self._wanted_ns = min(self._wanted_ns, self._longest_ns)
        self.lead_ns = self._wanted_ns
        return self.lead_ns

    def wait(self, left_ns: int, waiting_since_ns: int) -> None:
        """Busy-wait until the timer is due.

        Adjust the lead if the thread was already waiting when the kernel timer expired.

        Args:
            left_ns: time until then, at most `lead_ns`; negative if the timer is late.
            waiting_since_ns: when the thread last began to wait, on the monotonic clock.
        """
        due_ns = time.monotonic_ns() + left_ns
        if due_ns - self.lead_ns >= waiting_since_ns:
            change_ns = (_EARLY_NS - max(left_ns, -_LATEST_NS)) // _SMOOTHING
            self._wanted_ns = min(max(self._wanted_ns + change_ns, 0), self._longest_ns)
        while time.monotonic_ns() < due_ns:
            pass
