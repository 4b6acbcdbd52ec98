"""How old messages are when they come, read from where CDR has the stamp of a leading header.

In: serialized messages with the time of receipt. Out: percentiles over a window. No message is
deserialized: of a type that begins with `std_msgs/Header` the stamp is bytes 4 to 12.

Source: DDSI-RTPS 2.5, 10.2 (4 bytes of encapsulation, then the fields in order); rcl_interfaces
`builtin_interfaces/Time` (int32 sec, uint32 nanosec).
"""

import struct
from collections import deque
from collections.abc import Collection
from typing import Final

from obk_cli.looking.delays import OTHER_CLOCK_NS
from obk_cli.monitoring.view import Passage

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

    def __init__(self) -> None:
        """Begin with none."""
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
            self._stamps.append(stamp)
            self._delays_ns.append(received_ns - stamp)

    @property
    def stamps(self) -> Collection[int]:
        """Of the newest messages [ns]."""
        return self._stamps

    def passage(self, further_up: "Collection[PassageMeter]" = ()) -> Passage | None:
        """What was measured; None without stamps, or where they are of another clock.

        Args:
            further_up: of the topics that this one is made from.
        """
        if not self._delays_ns or abs(min(self._delays_ns)) > OTHER_CLOCK_NS:
            return None
        delays = sorted(self._delays_ns)
        known = frozenset(stamp for meter in further_up for stamp in meter.stamps)
        carried = sum(stamp in known for stamp in self._stamps)
        return Passage(
            p50_s=delays[len(delays) // 2] / _NS,
            p99_s=delays[min(len(delays) - 1, int(_NEAR_ALL * len(delays)))] / _NS,
            is_carried=carried > _CARRIED * len(self._stamps),
        )
