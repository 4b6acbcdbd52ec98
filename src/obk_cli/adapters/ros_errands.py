"""What a node that is there already does for others with messages, which travel as plain data.

In: a question, JSON's values, and the node's look. Out: what came of it, JSON's values:

- `{"about": "fields", "type": NAME}`: `fields`, with their types as generated packages name them.
- `{"about": "call", "service": NAME, "type": NAME, "request": DATA, "timeout_s": S}`: `response`.
- `{"about": "message", "topic": NAME, "type": NAME, "timeout_s": S}`: the next `message`; null
  where it is so long that to make data of it would hold up the node's process.
- `{"about": "publish", "topic": NAME, "type": NAME, "message": DATA, "subscribers": COUNT}`:
  `confirmed`, whether all who hear it have it; null where nothing was sent, because the topic moves
  a robot, or not so many hear this node.
- `{"about": "rates", "topics": {NAME: TYPE, ...}, "duration_s": S}`: `rates`, as `looking.rates`.
- `{"about": "delay", "topic": NAME, "type": NAME, "window": COUNT, "duration_s": S}`: `delay`, as
  `looking.delays`, null where no stamped message came, and how many were `unstamped`.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict
from itertools import islice
from typing import Any, Final

from obk_cli.looking.delays import DelayMeter
from obk_cli.looking.fill import require_fit
from obk_cli.looking.guard import moved_by
from obk_cli.looking.place import place_of
from obk_cli.looking.plain_data import Plain, plain_data
from obk_cli.looking.rates import LAUNCHER_COUNTS_S
from obk_cli.looking.stamps import stamp_of
from obk_cli.ros.environment import ros_environment
from obk_cli.ros.participant import RosLook
from obk_cli.ros.publisher import RosPublisher
from obk_cli.ros.rate_meter import RosMeter
from obk_cli.ros.raw_subscription import DropCounter, arrived, deserialized, serialized
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import fields_of, find_type, make_message, raw_type, short_type

__all__ = ["run_errand"]

LONGEST_S: Final = 3600.0
"""How long whoever is to answer may be waited for [s]."""
POLL_S: Final = 0.001
"""Between two looks for messages that are on their way [s]."""
HEARD_S: Final = 0.5
"""Within which those who are known to listen are known to a new publisher [s]."""
MOST_DELAYS: Final = 10_000
LONGEST_MESSAGE: Final = 1 << 16
"""Of which data is made here [bytes]: some ms of Python, in which other threads hardly run."""


def run_errand(look: RosLook, question: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What came of a question; None: it is none of these.

    Raises:
        CommandFailedError: the type is not here, or nobody answers in time.
        MisuseError: the request does not fit its type.
    """
    match question:
        case {"about": "fields", "type": str(kind)}:
            return {"fields": dict(fields_of(kind))}
        case {
            "about": "call",
            "service": str(service),
            "type": str(kind),
            "request": request,
            "timeout_s": int() | float() as wait_s,
        }:
            return {"response": _call(look, service, kind, request, min(wait_s, LONGEST_S))}
        case {
            "about": "message",
            "topic": str(topic),
            "type": str(kind),
            "timeout_s": int() | float() as wait_s,
        }:
            return {"message": _next(look, topic, kind, min(wait_s, LONGEST_S))}
        case {
            "about": "publish",
            "topic": str(topic),
            "type": str(kind),
            "message": message,
            "subscribers": int(subscribers),
        }:
            return {"confirmed": _publish(look, topic, kind, message, subscribers)}
        case {"about": "rates", "topics": dict(topics), "duration_s": int() | float() as count_s}:
            return {"rates": _rates(look, topics, min(count_s, LAUNCHER_COUNTS_S))}
        case {
            "about": "delay",
            "topic": str(topic),
            "type": str(kind),
            "window": int(window),
            "duration_s": int() | float() as count_s,
        }:
            return _delay(look, topic, kind, window, min(count_s, LAUNCHER_COUNTS_S))
    return None


def _call(look: RosLook, service: str, kind: str, request: object, timeout_s: float) -> Plain:
    asked = f"{kind}_Request"
    data = require_fit(request, asked, fields_of)
    client = ServiceClient(look, service, find_type(kind))
    return plain_data(client.call(make_message(asked, data), timeout_s))


def _next(look: RosLook, topic: str, kind: str, timeout_s: float) -> Plain:
    raw = look.listen(topic, kind, find_type(kind))
    try:
        (data,) = islice(serialized(raw, DropCounter(), timeout_s, each=True), 1)
    finally:
        raw.close()
    return None if len(data) > LONGEST_MESSAGE else plain_data(deserialized(data, raw))


def _publish(
    look: RosLook, topic: str, kind: str, message: object, subscribers: int
) -> bool | None:
    data = require_fit(message, kind, fields_of)
    plans = place_of(ros_environment(), look.domain).plans

    def moves_a_robot() -> bool:
        return bool(moved_by(look.topic(topic), plans))

    if moves_a_robot():
        return None
    publisher = RosPublisher(look, look.topic(topic), find_type(kind))
    try:
        are_there = look.wait_for(lambda: publisher.subscribers >= subscribers or None, HEARD_S)
        publisher.become_known(look.topic(topic))
        if not are_there or moves_a_robot():
            return None
        publisher.publish(make_message(kind, data))
        return publisher.rest()
    finally:
        publisher.close()


def _rates(look: RosLook, topics: Mapping[str, str], duration_s: float) -> Mapping[str, Any]:
    meter = RosMeter(look, duration_s)
    try:
        for name, kind in topics.items():
            hashes = (end.type_hash for end in look.topic(name).publishers)
            meter.add(name, kind, raw_type(kind, hashes))
        end = time.monotonic() + duration_s
        while time.monotonic() < end:
            meter.turn()
        return {name: asdict(rate) for name, rate in meter.rates().items()}
    finally:
        meter.close()


def _delay(
    look: RosLook, topic: str, kind: str, window: int, duration_s: float
) -> Mapping[str, Any]:
    stamp = stamp_of(short_type(kind), fields_of)
    raw = look.listen(topic, kind, find_type(kind))
    meter = DelayMeter(max(1, min(window, MOST_DELAYS)))
    try:
        end = time.monotonic() + duration_s
        while time.monotonic() < end:
            for received_ns, message in arrived(raw):
                meter.take(received_ns, stamp(message))
            time.sleep(POLL_S)
    finally:
        raw.close()
    delay = meter.delay()
    return {"delay": None if delay is None else asdict(delay), "unstamped": meter.unstamped}
