"""The clock of a recorded run's nodes: wall time, or simulated time read from message stamps."""

import struct
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from obelisk_recordings.layout import HEADER, MessageDefinition, layout_of
from obelisk_recordings.run import RecordedRun
from obelisk_spec.runtime_protocol import USE_SIM_TIME

__all__ = ["RecordedClock", "with_earlier_stamps"]

_NS_PER_S: Final = 1_000_000_000
Times = NDArray[np.int64]


class RecordedClock:
    """Converts publication times to the clock that the recorded run's nodes used, and back."""

    def __init__(self, run: RecordedRun) -> None:
        """Find out which clock the nodes used; for simulated time, read the stamps of all topics.

        Raises:
            RecordingError: the recording cannot be read.
        """
        parameters = [process.get("parameters") for process in run.processes]
        is_simulated = not run.is_lockstep and any(
            one.get(USE_SIM_TIME) for one in parameters if isinstance(one, dict)
        )
        stamps = [*_stamps(run)] if is_simulated else []
        published = np.concatenate([one for one, _ in stamps] or [np.empty(0, np.int64)])
        stamped = np.concatenate([one for _, one in stamps] or [np.empty(0, np.int64)])
        # In simulated time, which begins near 0, a stamp of today is of a node with another clock.
        is_early = stamped < published // 2
        published, stamped = published[is_early], stamped[is_early]
        order = np.argsort(published, kind="stable")
        self._published_ns = published[order]
        self._time_ns = np.maximum.accumulate(stamped[order])

    @property
    def is_simulated(self) -> bool:
        """Whether the times are simulated, and differ from those of publication."""
        return len(self._time_ns) > 0

    def time_ns(self, published_ns: int) -> int:
        """The time at a publication [ns], interpolated between stamps; without stamps, the same."""
        if not self.is_simulated:
            return published_ns
        start_ns = int(self._published_ns[0])
        times = self._published_ns - start_ns
        return round(float(np.interp(published_ns - start_ns, times, self._time_ns)))

    def published_ns(self, time_ns: int) -> int:
        """When the clock showed a time [ns since 1970], interpolated between stamps."""
        if not self.is_simulated:
            return time_ns
        first_ns, last_ns = int(self._time_ns[0]), int(self._time_ns[-1])
        start_ns = int(self._published_ns[0])
        inside = min(max(time_ns, first_ns), last_ns)
        passed = np.interp(inside, self._time_ns, self._published_ns - start_ns)
        return start_ns + round(float(passed)) + time_ns - inside


def _stamps(run: RecordedRun) -> Iterator[tuple[Times, Times]]:
    """Publication times and stamps [ns] of all topics with stamped messages."""
    definitions = run.definitions(run.topics)
    topics = {name for name, one in definitions.items() if _begins_with_header(one)}
    for part in run.parts(topics):
        is_set = part.stamps_ns > 0
        yield part.messages.published_ns[is_set], part.stamps_ns[is_set]


def _begins_with_header(definition: MessageDefinition) -> bool:
    """Whether the messages begin with a `std_msgs/Header`, and thus with a stamp."""
    first = next(iter(definition.types.get(definition.root, ())), None)
    return first is not None and (first.name, first.kind) == ("header", HEADER)


def with_earlier_stamps(message: bytes, definition: MessageDefinition, shift_ns: int) -> bytes:
    """Subtract a time from the stamps of all headers, except those that would become negative.

    These are not set, or of another clock.

    Raises:
        RecordingError: the headers cannot be located.
    """
    shifted = bytearray(message)
    form = "<iI" if message[1] & 1 else ">iI"
    for offset in layout_of(definition, message).stamps:
        seconds, nanoseconds = struct.unpack_from(form, message, offset)
        stamp_ns = seconds * _NS_PER_S + nanoseconds - shift_ns
        if stamp_ns >= 0:
            struct.pack_into(form, shifted, offset, *divmod(stamp_ns, _NS_PER_S))
    return bytes(shifted)
