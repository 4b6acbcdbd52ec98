"""Publishing from a bare participant: messages of plain data, once or at a rate."""

import time
from typing import Any, Final

from obk_cli.adapters.ros_look import RosLook

__all__ = ["RosPublisher"]

ACK_S: Final = 2.0
"""How long a subscriber that is there may take to have the last message [s]."""


class RosPublisher:
    """One topic's publisher; reliable, which everybody hears."""

    def __init__(
        self, look: RosLook, name: str, python_type: Any, *, is_transient_local: bool
    ) -> None:
        """Make the publisher.

        Args:
            look: whose participant publishes.
            name: full, of the topic.
            python_type: the message's class.
            is_transient_local: whether who comes later gets the last message too.
        """
        from rclpy.impl.implementation_singleton import rclpy_implementation
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rclpy.type_support import check_is_valid_msg_type

        check_is_valid_msg_type(python_type)  # type: ignore[no-untyped-call]
        durability = DurabilityPolicy
        qos: Any = QoSProfile(  # type: ignore[no-untyped-call]
            depth=10,
            durability=durability.TRANSIENT_LOCAL if is_transient_local else durability.VOLATILE,
        )
        with look.node:
            self._publisher: Any = rclpy_implementation.Publisher(
                look.node, python_type, name, qos.get_c_qos_profile()
            )

    @property
    def subscribers(self) -> int:
        """How many hear it by now."""
        return int(self._publisher.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Send a message."""
        self._publisher.publish(message)

    def rest(self) -> bool:
        """Wait until those who hear it reliably have the last message; whether they have."""
        from rclpy.duration import Duration

        duration: Any = Duration(seconds=ACK_S)
        return bool(self._publisher.wait_for_all_acked(duration._duration_handle))

    @staticmethod
    def until(time_s: float) -> None:
        """Wait until a time of the monotonic clock [s]."""
        time.sleep(max(0.0, time_s - time.monotonic()))
