"""How old messages are when they come, by the stamps in their headers.

In: stamp and time of receipt. Out: the least, mean and greatest delay. Looks at no clock.
"""

from collections import deque
from dataclasses import dataclass
from math import sqrt
from typing import Final

__all__ = ["Delay", "DelayMeter"]

OTHER_CLOCK_NS: Final = 10**16
"""About four months; farther apart are only stamps of another clock, such as a simulator's."""
_NS: Final = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """What was measured of one topic within the window."""

    seen: int
    """Messages."""
    is_relative: bool
    """Whether the stamps are of another clock; then the quickest message's delay counts as 0."""
    mean_s: float
    min_s: float
    max_s: float
    std_dev_s: float


class DelayMeter:
    """Keeps the delays of the newest messages."""

    def __init__(self, window: int) -> None:
        """Begin with none.

        Args:
            window: how many messages are kept.
        """
        self._delays_ns: deque[int] = deque(maxlen=window)
        self.unstamped = 0
        """Messages whose stamp is zero: it was never set."""

    def take(self, received_ns: int, stamp_ns: int) -> None:
        """Count a message: when it came and what its header says, both [ns]."""
        if stamp_ns:
            self._delays_ns.append(received_ns - stamp_ns)
        else:
            self.unstamped += 1

    def delay(self) -> Delay | None:
        """What was measured; None where no stamped message came."""
        if not self._delays_ns:
            return None
        least = min(self._delays_ns)
        is_relative = abs(least) > OTHER_CLOCK_NS
        zero = least if is_relative else 0
        delays = [one - zero for one in self._delays_ns]
        mean = sum(delays) / len(delays)
        variance = sum((one - mean) ** 2 for one in delays) / len(delays)
        return Delay(
            seen=len(delays),
            is_relative=is_relative,
            mean_s=mean * _NS,
            min_s=min(delays) * _NS,
            max_s=max(delays) * _NS,
            std_dev_s=sqrt(variance) * _NS,
        )
