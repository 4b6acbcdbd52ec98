"""Convert a message's time of receipt to simulated time, using the messages on `/clock`.

A simulator publishes `/clock` while it has subscribers, by default at 1 kHz.
"""

import struct
from bisect import bisect_right
from collections import deque
from typing import Final

from obelisk_spec.runtime_protocol import CLOCK_TOPIC
from obk_cli.ros.meters import RosMeter
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.raw_subscription import RawSubscription
from obk_cli.ros.types import find_type

__all__ = ["CLOCK_TYPE", "SimulatedClock", "follow_clock", "subscribe_to_clock"]

CLOCK_TYPE: Final = "rosgraph_msgs/msg/Clock"
KEPT_NS: Final = 1_000_000_000
"""How long messages of `/clock` are kept; other messages wait at most this long [ns]."""
SAMPLED_NS: Final = 50_000_000
"""Minimum time between two messages by which the pace is measured [ns]."""
_MOST_SAMPLED: Final = 200
_FEWEST_SAMPLED: Final = 5
_MOST_KEPT: Final = 10_000
_NS: Final = 1_000_000_000
_TIME: Final = struct.Struct("<4xiI")
"""CDR of a `Clock` in the usual byte order."""


class SimulatedClock:
    """The latest times of `/clock`; a time that goes back starts a new epoch."""

    def __init__(self) -> None:
        """Start without times."""
        self._received: deque[int] = deque(maxlen=_MOST_KEPT)
        self._times: deque[int] = deque(maxlen=_MOST_KEPT)
        self._sampled: deque[tuple[int, int]] = deque(maxlen=_MOST_SAMPLED)
        """Times of receipt and values of some messages, over a longer time than the others."""
        self.epoch = 0
        """How often the simulated time was reset."""

    def take(self, received_ns: int, data: bytes) -> None:
        """Process a message of `/clock`.

        Args:
            received_ns: time of receipt [ns since 1970].
            data: the serialized message, with its encapsulation.
        """
        if len(data) < _TIME.size:
            return
        seconds, rest = _TIME.unpack_from(data)
        time_ns = seconds * _NS + rest
        if self._times and time_ns < self._times[-1]:
            self._received.clear()
            self._times.clear()
            self._sampled.clear()
            self.epoch += 1
        while self._received and self._received[0] < received_ns - KEPT_NS:
            self._received.popleft()
            self._times.popleft()
        self._received.append(received_ns)
        self._times.append(time_ns)
        if not self._sampled or received_ns - self._sampled[-1][0] >= SAMPLED_NS:
            self._sampled.append((received_ns, time_ns))

    def take_waiting(self, raw: RawSubscription) -> None:
        """Process the waiting messages of a subscription from `subscribe_to_clock`."""
        for data, info in raw.take():
            self.take(info["received_timestamp"], data)

    def pace(self, since_ns: int) -> float | None:
        """Simulated time over wall time; 0 while it is paused, None before the first time.

        Args:
            since_ns: start of the measurement [ns since 1970].
        """
        if not self._sampled:
            return None
        newest = [sample for sample in self._sampled if sample[0] >= since_ns]
        if len(newest) < _FEWEST_SAMPLED:
            return 0.0
        (first_ns, first_time_ns), (last_ns, last_time_ns) = newest[0], newest[-1]
        return (last_time_ns - first_time_ns) / (last_ns - first_ns)

    def at(self, received_ns: int) -> int | None:
        """The simulated time [ns] of a node that has received all messages up to a time.

        Args:
            received_ns: a time of the wall clock [ns since 1970].

        Returns:
            The last simulated time before it; for an earlier time, the first known one; None if
            none was received in this epoch.
        """
        if not self._times:
            return None
        if received_ns >= self._received[-1]:
            return self._times[-1]
        return self._times[max(0, bisect_right(self._received, received_ns) - 1)]


def follow_clock(meter: RosMeter, clock: SimulatedClock) -> None:
    """Process `/clock` with a meter, in each turn before other topics."""
    kind = find_type(CLOCK_TYPE)
    meter.add(CLOCK_TOPIC, CLOCK_TYPE, kind, clock.take, is_light=True, is_first=True)


def subscribe_to_clock(participant: RosParticipant) -> RawSubscription:
    """Subscribe to `/clock` without a meter."""
    return participant.subscribe(CLOCK_TOPIC, CLOCK_TYPE, find_type(CLOCK_TYPE), is_light=True)
