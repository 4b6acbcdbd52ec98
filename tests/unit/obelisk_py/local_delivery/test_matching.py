"""Who may do without DDS: profiles that ask for nothing but history, depth and reliability."""

import pytest
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
    qos_profile_system_default,
)

from obelisk_py.core.local_delivery.matching import is_compatible, is_plain

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT, qos_profile_sensor_data])
def test_depth_and_reliability_need_no_dds(qos: QoSProfile) -> None:
    assert is_plain(qos)


@pytest.mark.parametrize(
    "qos",
    [
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        QoSProfile(depth=1, durability=DurabilityPolicy.SYSTEM_DEFAULT),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.SYSTEM_DEFAULT),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_AVAILABLE),
        QoSProfile(depth=1, deadline=Duration(seconds=1)),
        QoSProfile(depth=1, lifespan=Duration(seconds=1)),
        QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1)),
        QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC),
        QoSProfile(depth=1, avoid_ros_namespace_conventions=True),
        QoSProfile(history=HistoryPolicy.KEEP_ALL),
        qos_profile_system_default,
    ],
)
def test_what_else_a_profile_asks_for_is_left_to_dds(qos: QoSProfile) -> None:
    assert not is_plain(qos)


@pytest.mark.parametrize(
    ("publisher", "subscription", "compatible"),
    [
        (RELIABLE, RELIABLE, True),
        (RELIABLE, BEST_EFFORT, True),
        (BEST_EFFORT, BEST_EFFORT, True),
        (BEST_EFFORT, RELIABLE, False),
    ],
)
def test_a_reliable_subscription_needs_a_reliable_publisher(
    publisher: QoSProfile, subscription: QoSProfile, compatible: bool
) -> None:
    assert is_compatible(publisher, subscription) is compatible
