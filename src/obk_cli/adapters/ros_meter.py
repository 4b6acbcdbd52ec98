"""Rates of many topics at once, from messages as they are sent: nothing is deserialized.

One thread calls `turn` again and again: whatever has come is counted, every 5 ms at most. For live
tables and for single measurements alike.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from obk_cli.adapters.raw_topics import RawTopic
from obk_cli.adapters.ros_look import RosLook
from obk_cli.looking.rates import Meter, Rate

__all__ = ["RosMeter", "Watch"]

Watch = Callable[[int, bytes], None]
"""Takes when a message was received [ns since 1970], and the message as it was sent."""

TURN_S: Final = 0.005
"""Between two looks at the subscriptions [s]."""
LOOK_S: Final = 0.1
"""Between two looks at the publishers [s]."""


class RosMeter:
    """Counts the messages of topics."""

    def __init__(self, look: RosLook, window_s: float) -> None:
        """Begin with no topic.

        Args:
            look: whose participant listens.
            window_s: how far back figures go [s].
        """
        self._look = look
        self._window_s = window_s
        self._topics: dict[str, tuple[RawTopic, Meter, Watch | None]] = {}
        self._looked = time.monotonic()

    def add(
        self,
        name: str,
        msg_type: str,
        python_type: Any,
        watch: Watch | None = None,
        *,
        window_s: float | None = None,
    ) -> None:
        """Count a topic's messages from now on; one that is counted already goes on.

        Args:
            name: full.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            watch: is shown each message.
            window_s: how far back its figures go [s]; None: as those of others.
        """
        if name not in self._topics:
            raw = self._look.listen(name, msg_type, python_type)
            self._topics[name] = (raw, Meter(window_s or self._window_s), watch)

    def drop(self, name: str) -> None:
        """Count a topic's messages no more."""
        raw, _, _ = self._topics.pop(name)
        raw.close()

    def turn(self) -> None:
        """Count what has come, then rest until 5 ms are over."""
        begin = time.monotonic()
        if begin - self._looked > LOOK_S:
            self._looked = begin
            for raw, _, _ in self._topics.values():
                raw.look()
        for raw, meter, watch in self._topics.values():
            meter.publishers = raw.publishers
            take = meter.take
            for data, info in raw.take():
                received_ns = info["received_timestamp"]
                take(received_ns, len(data), info["publication_sequence_number"])
                if watch is not None:
                    watch(received_ns, data)
        time.sleep(max(0.0, TURN_S - (time.monotonic() - begin)))

    def rates(self) -> Mapping[str, Rate]:
        """What was measured by now, by topic."""
        now_ns = time.time_ns()
        return {name: meter.rate(now_ns) for name, (_, meter, _) in self._topics.items()}
