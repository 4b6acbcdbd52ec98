"""Which publishers and subscriptions may do without DDS, and which of them it would match.

Anything beyond history, depth and reliability is DDS's own business: late joiners (transient
local), deadlines, lifespans, liveliness. Whoever asks for these, or leaves a choice to the
middleware, gets it from DDS.
"""

import functools
import os
from typing import Final

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.utilities import get_rmw_implementation_identifier

__all__ = ["is_compatible", "is_plain", "middleware_is_known"]

_RELIABILITIES: Final = (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
_LIVELINESSES: Final = (LivelinessPolicy.SYSTEM_DEFAULT, LivelinessPolicy.AUTOMATIC)
_UNSET: Final = QoSProfile(depth=1)


@functools.cache
def middleware_is_known() -> bool:
    """Whether endpoints of one context are matched before the call that makes one returns.

    So it is in Fast DDS; and that the profile in Python is the one that holds, unless the process
    takes profiles from XML.
    """
    return (
        get_rmw_implementation_identifier() == "rmw_fastrtps_cpp"
        and os.environ.get("RMW_FASTRTPS_USE_QOS_FROM_XML") != "1"
    )


def is_plain(qos: QoSProfile) -> bool:
    """Whether a profile asks for nothing that only DDS does."""
    return bool(
        qos.history == HistoryPolicy.KEEP_LAST
        and qos.depth > 0
        and qos.reliability in _RELIABILITIES
        and qos.durability == DurabilityPolicy.VOLATILE
        and qos.liveliness in _LIVELINESSES
        and qos.deadline == _UNSET.deadline
        and qos.lifespan == _UNSET.lifespan
        and qos.liveliness_lease_duration == _UNSET.liveliness_lease_duration
        # It would be another topic of DDS.
        and not qos.avoid_ros_namespace_conventions
    )


def is_compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """Whether DDS matches two plain profiles: a reliable subscription needs a reliable publisher.

    Source: OMG DDS 1.4, 2.2.3.14 (RELIABILITY, offered against requested).
    """
    return bool(
        publisher.reliability == ReliabilityPolicy.RELIABLE
        or subscription.reliability == ReliabilityPolicy.BEST_EFFORT
    )
