"""Messages of a topic, one after another, as sent and as objects; waiting has a deadline."""

import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from obelisk_spec.wording import with_number
from obk_cli.adapters.raw_topics import RawTopic
from obk_cli.errors import CommandFailedError
from obk_cli.recording.tally import Tally

__all__ = ["arrived", "deserialized", "messages", "serialized"]

POLL_S: Final = 0.002
LOOK_S: Final = 0.1
"""Between two looks at the publishers [s]."""


def messages(raw: RawTopic, tally: Tally, timeout_s: float, *, each: bool) -> Iterator[Any]:
    """The messages that come, without end; see `serialized`."""
    for data in serialized(raw, tally, timeout_s, each=each):
        yield deserialized(data, raw)


def deserialized(data: bytes, raw: RawTopic) -> Any:
    """A message of a topic as an object.

    Raises:
        CommandFailedError: the bytes are no such message; types are matched by their names alone.
    """
    from rclpy.serialization import deserialize_message

    try:
        return deserialize_message(data, raw.python_type)
    except Exception as error:  # of the middleware, without a class of its own
        raise CommandFailedError(
            f"a message came on {raw.name} that is no {raw.msg_type} as it is built here",
            help="its publisher may have another definition of the type: build both from the same",
        ) from error


def serialized(raw: RawTopic, tally: Tally, timeout_s: float, *, each: bool) -> Iterator[bytes]:
    """The messages that come as they were sent, without end.

    Args:
        raw: the topic.
        tally: counts them, and those that were lost.
        timeout_s: for the first message [s].
        each: whether the deadline is for every later one too.

    Raises:
        CommandFailedError: none came in time.
    """
    heard = looked = time.monotonic()
    while True:
        for data, info in raw.take():
            tally.take(info["publication_sequence_number"], raw.publishers)
            heard = time.monotonic()
            yield data
        now = time.monotonic()
        if now > heard + timeout_s and (each or not tally.count):
            raise CommandFailedError(
                f"no message came on {raw.name} within {timeout_s:g} s",
                help=f"it has {with_number(raw.publishers, 'publisher')}: "
                f"`obk topic info {raw.name}` shows them, `obk lifecycle get` whether their nodes "
                "are active",
            )
        if now > looked + LOOK_S:
            looked = now
            raw.look()
        time.sleep(POLL_S)


def arrived(
    raw: RawTopic, is_wanted: Callable[[int], bool] = lambda _: True
) -> Iterator[tuple[int, Any]]:
    """When each message that waits was received [ns since 1970], and the message.

    Args:
        raw: the topic.
        is_wanted: is asked by the time of receipt; other messages are passed over unread.
    """
    for data, info in raw.take():
        received_ns = info["received_timestamp"]
        if is_wanted(received_ns):
            yield received_ns, deserialized(data, raw)
