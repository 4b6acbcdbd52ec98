"""How old messages are when they come, read from where CDR has the stamp of a leading header.

In: serialized messages with the time of receipt. Out: percentiles over a window, as that of rates.
No message is deserialized: of a type that begins with `std_msgs/Header` the stamp is bytes 4 to 12.

Source: DDSI-RTPS 2.5, 10.2 (4 bytes of encapsulation, then the fields in order); rcl_interfaces
`builtin_interfaces/Time` (int32 sec, uint32 nanosec).
"""

import struct
from collections import deque
from collections.abc import Collection, Sequence
from itertools import chain
from typing import Final

from obk_cli.monitor.model import Passage
from obk_cli.ros.latency import OTHER_CLOCK_NS

__all__ = ["PassageMeter"]

_LITTLE: Final = struct.Struct("<iI")
_BIG: Final = struct.Struct(">iI")
_AFTER_ENCAPSULATION: Final = 4
_SHORTEST: Final = _AFTER_ENCAPSULATION + _LITTLE.size
_NS: Final = 1_000_000_000
_KEPT: Final = 1000
_NEAR_ALL: Final = 0.99
_CARRIED: Final = 0.5
"""The share of stamps known from further up from which a topic counts as carrying them on."""


class PassageMeter:
    """Keeps the stamps and delays of a topic's newest messages."""

    def __init__(self, window_s: float) -> None:
        """Begin with none.

        Args:
            window_s: how far back figures go [s].
        """
        self._window_ns = round(window_s * _NS)
        self._received: deque[int] = deque(maxlen=_KEPT)
        self._stamps: deque[int] = deque(maxlen=_KEPT)
        self._delays_ns: deque[int] = deque(maxlen=_KEPT)

    def take(self, received_ns: int, data: bytes) -> None:
        """Count a message of a type that begins with a header.

        Args:
            received_ns: when it came [ns since 1970].
            data: as it was sent, with its encapsulation.
        """
        if len(data) < _SHORTEST:
            return
        order = _LITTLE if data[1] & 1 else _BIG
        seconds, rest = order.unpack_from(data, _AFTER_ENCAPSULATION)
        stamp = seconds * _NS + rest
        if stamp:
            self._received.append(received_ns)
            self._stamps.append(stamp)
            self._delays_ns.append(received_ns - stamp)

    @property
    def stamps(self) -> Collection[int]:
        """Of the newest messages [ns]."""
        return self._stamps

    def passage(self, now_ns: int, further_up: "Collection[PassageMeter]" = ()) -> Passage | None:
        """What was measured by now; None without stamps, or where they are of another clock.

        Args:
            now_ns: the clock by which messages were received [ns since 1970].
            further_up: of the topics that this one is made from.
        """
        self._forget(now_ns - self._window_ns)
        if not self._delays_ns or abs(min(self._delays_ns)) > OTHER_CLOCK_NS:
            return None
        delays = sorted(self._delays_ns)
        return Passage(
            p50_s=delays[len(delays) // 2] / _NS,
            p99_s=delays[min(len(delays) - 1, int(_NEAR_ALL * len(delays)))] / _NS,
            is_carried=self._are_carried([meter.stamps for meter in further_up if meter.stamps]),
        )

    def _are_carried(self, further_up: Sequence[Collection[int]]) -> bool:
        """Whether the stamps are known from further up, as far back as all of there are kept."""
        since = max(map(min, further_up), default=0)
        known = frozenset(chain.from_iterable(further_up))
        judged = [stamp for stamp in self._stamps if stamp >= since]
        return sum(stamp in known for stamp in judged) > _CARRIED * len(judged)

    def _forget(self, before_ns: int) -> None:
        # Stamps stay: those of topics further down, which are later, are held against them.
        while self._received and self._received[0] < before_ns:
            self._received.popleft()
            self._delays_ns.popleft()
