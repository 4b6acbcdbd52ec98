"""Rates of many topics at once, from messages as they are sent: nothing is deserialized.

One thread calls `turn` again and again: whatever has come is counted, every 5 ms unless told
otherwise. For live tables and for single measurements alike.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from obk_cli.ros.participant import RosLook
from obk_cli.ros.rates import Meter, TopicRate
from obk_cli.ros.raw_subscription import RawTopic

__all__ = ["RosMeter", "Watch"]

Watch = Callable[[int, bytes], None]
"""Takes when a message was received [ns since 1970], and the message as it was sent."""

TURN_S: Final = 0.005
"""Between two looks at the subscriptions [s]."""
LOOK_S: Final = 0.1
"""Between two looks at the publishers [s]."""

OLD_NS: Final = 500_000_000
"""For which messages may be taken for old ones [ns]."""


class RosMeter:
    """Counts the messages of topics."""

    def __init__(self, look: RosLook, window_s: float, turn_s: float = TURN_S) -> None:
        """Begin with no topic.

        Args:
            look: whose participant listens.
            window_s: how far back figures go [s].
            turn_s: between two looks at what has come [s]; times are the middleware's all the same.
        """
        self._look = look
        self._window_s = window_s
        self._turn_s = turn_s
        self._topics: dict[str, _Counted] = {}
        self._looked = time.monotonic()

    def add(
        self,
        name: str,
        msg_type: str,
        python_type: Any,
        watch: Watch | None = None,
        *,
        window_s: float | None = None,
        is_light: bool = False,
    ) -> None:
        """Count a topic's messages from now on; one that is counted already goes on.

        Args:
            name: full.
            msg_type: full, `pkg/msg/Name`.
            python_type: the message's class.
            watch: is shown each message.
            window_s: how far back its figures go [s]; None: as those of others.
            is_light: cost its publishers little, and miss a message rather.
        """
        if name not in self._topics:
            raw = self._look.listen(name, msg_type, python_type, is_light=is_light)
            self._topics[name] = _Counted(raw, Meter(window_s or self._window_s), watch)

    def drop(self, name: str) -> None:
        """Count a topic's messages no more."""
        self._topics.pop(name).raw.close()

    def close(self) -> None:
        """Count no topic any more."""
        for name in tuple(self._topics):
            self.drop(name)

    def turn(self) -> None:
        """Count what has come, then rest until the turn is over."""
        begin = time.monotonic()
        self._take(begin)
        time.sleep(max(0.0, self._turn_s - (time.monotonic() - begin)))

    def rates(self) -> Mapping[str, TopicRate]:
        """What was measured by now, by topic."""
        # Whoever asks may have rested or waited for others: what has come since is counted too.
        self._take(time.monotonic())
        now_ns = time.time_ns()
        return {name: topic.meter.rate(now_ns) for name, topic in self._topics.items()}

    def _take(self, begin: float) -> None:
        if begin - self._looked > LOOK_S:
            self._looked = begin
            for topic in self._topics.values():
                topic.raw.look()
        for topic in self._topics.values():
            meter, watch = topic.meter, topic.watch
            meter.publishers = topic.raw.publishers
            take = meter.take
            for data, info in topic.raw.take():
                received_ns = info["received_timestamp"]
                if not topic.is_fresh and topic.is_old(received_ns, info["source_timestamp"]):
                    continue
                take(received_ns, len(data), info["publication_sequence_number"])
                if watch is not None:
                    watch(received_ns, data)


class _Counted:
    """A topic whose messages are counted, but for those that its publisher had kept."""

    __slots__ = ("_begun_ns", "_first_ns", "is_fresh", "meter", "raw", "watch")

    def __init__(self, raw: RawTopic, meter: Meter, watch: Watch | None) -> None:
        self.raw = raw
        self.meter = meter
        self.watch = watch
        self.is_fresh = False
        """Whether a message has come that was published since."""
        self._begun_ns = time.time_ns()
        self._first_ns: int | None = None

    def is_old(self, received_ns: int, published_ns: int) -> bool:
        """Whether it was published before anybody listened here.

        Such messages come all at once, as if the rate were higher. A publisher's clock may be
        behind: so this ends soon after the first message.
        """
        if self._first_ns is None:
            self._first_ns = received_ns
        is_new = published_ns >= self._begun_ns
        self.is_fresh = is_new or received_ns - self._first_ns > OLD_NS
        return not self.is_fresh
