"""The subscriptions of a topic, with their GIDs."""

from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from obelisk_spec.local_transport.dds_reader import GID_BYTES

__all__ = ["SubscriptionEndpoint", "subscriptions_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SubscriptionEndpoint:
    """A subscription in the ROS graph."""

    gid: bytes
    node: tuple[str, str]
    """Name and namespace."""
    type_name: str
    is_reliable: bool
    is_volatile: bool


def subscriptions_of(node_handle: Any, topic: str) -> list[SubscriptionEndpoint]:
    """The subscriptions of a topic that the node's context has discovered, its own too.

    A subscription is listed before DDS counts it as matched with a publisher.

    Args:
        node_handle: of rclpy.
        topic: its full name.
    """
    with node_handle:
        found = rclpy_implementation.rclpy_get_subscriptions_info_by_topic(
            node_handle, topic, False
        )
    return [
        SubscriptionEndpoint(
            gid=bytes(info["endpoint_gid"][:GID_BYTES]),
            node=(info["node_name"], info["node_namespace"]),
            type_name=info["topic_type"],
            is_reliable=info["qos_profile"]["reliability"] == ReliabilityPolicy.RELIABLE,
            is_volatile=info["qos_profile"]["durability"] == DurabilityPolicy.VOLATILE,
        )
        for info in found
    ]
