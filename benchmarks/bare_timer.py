"""A timer without work, which measures the rate that the machine can currently keep.

`python -m benchmarks.bare_timer` prints a line of JSON per second until its standard input is
closed.
"""

import json
import select
import sys
import time
from dataclasses import asdict, dataclass
from typing import Final

import psutil

from benchmarks.stolen import StolenTime

__all__ = ["BareSecond", "bare_second"]

RATE_HZ: Final = 1000
PERIOD_NS: Final = 10**9 // RATE_HZ


@dataclass(frozen=True, slots=True, kw_only=True)
class BareSecond:
    """The measurements of one second."""

    at_s: float
    """The end of the second, on the monotonic clock."""
    kept: float
    """The fraction of the expected ticks that happened."""
    late_p99_us: float
    stolen_percent: float
    """Of one core."""
    idle_percent: float
    """Of all cores."""


def bare_second() -> BareSecond:
    """Tick for one second and return the measurements."""
    stolen = StolenTime()
    psutil.cpu_times_percent(None)
    start_ns = due_ns = time.monotonic_ns()
    late_ns = []
    while due_ns - start_ns < 10**9:
        time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
        late_ns.append(time.monotonic_ns() - due_ns)
        # Missed ticks are skipped.
        due_ns += (late_ns[-1] // PERIOD_NS + 1) * PERIOD_NS
    late_ns.sort()
    return BareSecond(
        at_s=time.monotonic(),
        kept=len(late_ns) / RATE_HZ,
        late_p99_us=late_ns[len(late_ns) * 99 // 100] / 1e3,
        stolen_percent=stolen.percent(),
        idle_percent=psutil.cpu_times_percent(None).idle,
    )


def main() -> None:
    """Print the measurements once a second."""
    while not select.select([sys.stdin], [], [], 0)[0]:
        print(json.dumps(asdict(bare_second())), flush=True)


if __name__ == "__main__":
    main()
