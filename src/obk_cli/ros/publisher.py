"""Publish on one topic, once or at a rate, from a bare participant."""

import os
import re
import time
from pathlib import Path
from typing import Any, Final

from obk_cli.process.identity import start_s
from obk_cli.ros.graph import TopicInfo
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.types import require_message

__all__ = ["ALLOWED_PUBLISHER", "RosPublisher", "is_allowed_publisher"]

ACK_S: Final = 5.0
"""Limit for a known subscriber to receive the last message [s]."""
KNOWN_S: Final = 0.1
"""Time for best-effort subscriptions to discover a publisher [s]."""


class RosPublisher:
    """A publisher of one topic; reliable, so that it matches every subscription."""

    def __init__(
        self, participant: RosParticipant, topic: TopicInfo, python_type: Any, *, depth: int = 10
    ) -> None:
        """Create the publisher.

        Args:
            participant: the participant that publishes.
            topic: with its subscriptions; `transient_local` is offered if one requests it.
            python_type: the message's class.
            depth: history depth: number of messages that wait for a slow subscription.

        Raises:
            CommandFailedError: messages of the class cannot be sent here.
        """
        from rclpy.impl.implementation_singleton import rclpy_implementation
        from rclpy.qos import DurabilityPolicy, QoSProfile

        require_message(python_type)
        is_latched = any(e.qos.durability == "transient_local" for e in topic.subscriptions)
        durability = DurabilityPolicy
        qos: Any = QoSProfile(  # type: ignore[no-untyped-call]
            depth=depth,
            durability=durability.TRANSIENT_LOCAL if is_latched else durability.VOLATILE,
        )
        with participant.node:
            self._publisher: Any = rclpy_implementation.Publisher(
                participant.node, python_type, topic.name, qos.get_c_qos_profile()
            )

    @property
    def subscribers(self) -> int:
        """The number of matched subscriptions."""
        return int(self._publisher.get_subscription_count())

    @staticmethod
    def wait_until_discovered(topic: TopicInfo) -> None:
        """Wait for best-effort subscriptions, because missed messages are not sent again."""
        if any(end.qos.reliability != "reliable" for end in topic.subscriptions):
            time.sleep(KNOWN_S)

    def publish(self, message: Any) -> None:
        """Send a message."""
        self._publisher.publish(message)

    def publish_bytes(self, data: bytes) -> None:
        """Send a serialized message."""
        self._publisher.publish_raw(data)

    def rest(self) -> bool:
        """Wait until reliable subscriptions have the last message; return whether they have."""
        from rclpy.duration import Duration

        duration: Any = Duration(seconds=ACK_S)
        return bool(self._publisher.wait_for_all_acked(duration._duration_handle))

    def close(self) -> None:
        """Destroy the publisher."""
        self._publisher.destroy_when_not_in_use()

    @staticmethod
    def until(time_s: float) -> None:
        """Wait until a time of the monotonic clock [s]."""
        time.sleep(max(0.0, time_s - time.monotonic()))


ALLOWED_PUBLISHER: Final = "obk_allowed_publisher"
"""The node's name; the process id follows."""
_NODE: Final = re.compile(rf"/{ALLOWED_PUBLISHER}_(?P<pid>[1-9]\d{{0,9}})", re.ASCII)


def is_allowed_publisher(node: str, since_s: float) -> bool:
    """Whether a node belongs to a command of this user that started after a time.

    Args:
        node: full name.
        since_s: earlier commands were not meant for the current stack [s since boot].
    """
    match = _NODE.fullmatch(node)
    if match is None:
        return False
    pid = int(match["pid"])
    try:
        is_own = Path(f"/proc/{pid}").stat().st_uid == os.geteuid()
    except OSError:
        return False
    start = start_s(pid)
    return is_own and start is not None and start >= since_s
