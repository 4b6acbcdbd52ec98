"""How old messages are when they are received, by the stamps in their headers. Reads no clock."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.ros.field_path import FieldsOf

__all__ = ["Delay", "DelayMeter", "is_of_other_clock", "stamp_getter"]

OTHER_CLOCK_NS: Final = 10**16
"""About four months; farther apart are only stamps of another clock, such as a simulator's."""
_NS: Final = 1e-9


def is_of_other_clock(received_ns: int, stamp_ns: int) -> bool:
    """Whether a stamp [ns] is not of the wall clock by which its message was received."""
    return abs(received_ns - stamp_ns) > OTHER_CLOCK_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """What was measured of one topic within the window."""

    seen: int
    """Messages."""
    is_simulated: bool
    """Whether the delays are in simulated time, as the stamps are."""
    is_relative: bool
    """Whether the stamps' clock is unknown; then the quickest message's delay counts as 0."""
    pace: float
    """Seconds of the stamps' clock in one of the wall's; 1 where it is the wall's."""
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
        self._taken: deque[tuple[int, int]] = deque(maxlen=window)
        self._simulated: deque[int] = deque(maxlen=window)
        """Delays in simulated time [ns]."""
        self.unstamped = 0
        """Messages whose stamp is zero: it was never set."""

    def take(self, received_ns: int, stamp_ns: int, simulated_ns: int | None = None) -> None:
        """Count a message.

        Args:
            received_ns: when it came [ns since 1970].
            stamp_ns: the stamp in its header [ns].
            simulated_ns: the simulated time when it came [ns]; None: not known.
        """
        if not stamp_ns:
            self.unstamped += 1
            return
        self._taken.append((received_ns, stamp_ns))
        if simulated_ns is not None and is_of_other_clock(received_ns, stamp_ns):
            # `/clock` may come after the message of the same step.
            self._simulated.append(max(0, simulated_ns - stamp_ns))

    def delay(self) -> Delay | None:
        """What was measured; None where no stamped message came."""
        if not self._taken:
            return None
        delays: list[float] = [received - stamp for received, stamp in self._taken]
        is_other = abs(min(delays)) > OTHER_CLOCK_NS
        is_simulated = is_other and bool(self._simulated)
        pace = self._pace() if is_other else 1.0
        if is_simulated:
            delays = list(self._simulated)
        elif is_other:
            delays = self._above_the_quickest(pace)
        mean = sum(delays) / len(delays)
        variance = sum((one - mean) ** 2 for one in delays) / len(delays)
        return Delay(
            seen=len(delays),
            is_simulated=is_simulated,
            is_relative=is_other and not is_simulated,
            pace=pace,
            mean_s=mean * _NS,
            min_s=min(delays) * _NS,
            max_s=max(delays) * _NS,
            std_dev_s=sqrt(variance) * _NS,
        )

    def _pace(self) -> float:
        """From the first message to the last."""
        (first_ns, first_stamp_ns), (last_ns, last_stamp_ns) = self._taken[0], self._taken[-1]
        passed_ns, stamped_ns = last_ns - first_ns, last_stamp_ns - first_stamp_ns
        return stamped_ns / passed_ns if passed_ns > 0 and stamped_ns > 0 else 1.0

    def _above_the_quickest(self, pace: float) -> list[float]:
        """Delays in wall time [ns]."""
        first_ns, first_stamp_ns = self._taken[0]
        delays = [
            received - first_ns - (stamp - first_stamp_ns) / pace for received, stamp in self._taken
        ]
        least = min(delays)
        return [one - least for one in delays]


HEADER: Final = "std_msgs/Header"
TIME: Final = "builtin_interfaces/Time"
NS: Final = 1_000_000_000


def stamp_getter(msg_type: str, fields_of: FieldsOf) -> Callable[[Any], int]:
    """A function that returns the stamp of a message [ns].

    Args:
        msg_type: `pkg/Name`.
        fields_of: where types are looked up.

    Raises:
        CommandFailedError: such messages have none.
    """
    fields = fields_of(msg_type)
    header = next((name for name, kind in fields.items() if kind == HEADER), None)
    if header is not None:
        return lambda message: _ns(getattr(message, header).stamp)
    time = next((name for name, kind in fields.items() if kind == TIME), None)
    if time is None:
        raise CommandFailedError(
            f"{msg_type} has no header and no stamp, so the age of a message is unknown"
        )
    return lambda message: _ns(getattr(message, time))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NS + int(stamp.nanosec)
