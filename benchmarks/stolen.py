"""Measure the CPU time that the host of a virtual machine steals from it.

Stolen time does not affect CPU times of processes, but it does affect durations and rates, so
results with those also have `stolen_percent`. Part of it is caused by the measured program's own
wake-ups, because each of them waits for the host. Compare it only between runs of the same case.
"""

import sys
import time
from typing import Final

import psutil

__all__ = ["DISTURBED_PERCENT", "StolenTime", "warn_of_stolen_time"]

DISTURBED_PERCENT: Final = 5.0
"""Percentage of one core above which the host affects durations and rates noticeably."""


class StolenTime:
    """Measures the time stolen since its creation."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._stolen_s = psutil.cpu_times().steal

    def percent(self) -> float:
        """Stolen time in percent of one core."""
        seconds = time.monotonic() - self._start_s
        return round(100 * (psutil.cpu_times().steal - self._stolen_s) / seconds, 1)


def warn_of_stolen_time(percent: float) -> None:
    """Warn on standard error if too much time was stolen."""
    if percent > DISTURBED_PERCENT:
        print(
            f"the host stole {percent:.0f} % of a core during the measurement: durations and rates "
            "are unreliable",
            file=sys.stderr,
        )
