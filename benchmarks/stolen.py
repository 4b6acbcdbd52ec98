"""Processor time that the host of a virtual machine kept from it.

Process times are free of it. What happens at a moment, and how often in a second, is not: a result
that holds seconds or rates holds `stolen_percent` too. A part of it is the price of one's own
wake-ups, each of which waits for the host; so it is reported, and compared only between equals.
"""

import sys
import time
from typing import Final

import psutil

__all__ = ["DISTURBED_PERCENT", "StolenTime", "warn_of_stolen_time"]

DISTURBED_PERCENT: Final = 5.0
"""Of one core: above it, times and rates are the host's as much as ours."""


class StolenTime:
    """What was stolen since this was made."""

    def __init__(self) -> None:
        self._begin_s = time.monotonic()
        self._stolen_s = psutil.cpu_times().steal

    def percent(self) -> float:
        """Of one core."""
        seconds = time.monotonic() - self._begin_s
        return round(100 * (psutil.cpu_times().steal - self._stolen_s) / seconds, 1)


def warn_of_stolen_time(percent: float) -> None:
    """A line on standard error where it is too much."""
    if percent > DISTURBED_PERCENT:
        print(
            f"the host took {percent:.0f} % of a core meanwhile: seconds and rates of this run "
            "are the host's too",
            file=sys.stderr,
        )
