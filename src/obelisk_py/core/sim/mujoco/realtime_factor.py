"""The ROS parameter `realtime_factor`: what it may be, and when it may be changed.

In: a value, or parameters that somebody sets. Out: the factor, or why there is none. It is read at
configure: the schedule, the cameras and the promised rate are made from it.
"""

import math
from collections.abc import Sequence
from typing import Final

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["REALTIME_FACTOR", "realtime_factor_of", "refuse_while_configured"]

REALTIME_FACTOR: Final = "realtime_factor"


def realtime_factor_of(value: object) -> float:
    """Simulation time over wall time; 0: as fast as possible.

    Raises:
        ObeliskConfigError: the value is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ObeliskConfigError(f"the parameter '{REALTIME_FACTOR}' is {value!r}, no number")
    if not (math.isfinite(value) and value >= 0):
        raise ObeliskConfigError(
            f"the parameter '{REALTIME_FACTOR}' is {value:g}; expected a number above 0, or 0 "
            "for as fast as possible"
        )
    return float(value)


def refuse_while_configured(
    parameters: Sequence[Parameter], *, is_configured: bool
) -> SetParametersResult:
    """Whether parameters may be set: the factor only of a robot that is not configured."""
    if is_configured and any(parameter.name == REALTIME_FACTOR for parameter in parameters):
        return SetParametersResult(
            successful=False,
            reason=f"'{REALTIME_FACTOR}' is read at configure: clean up, set it, configure again",
        )
    return SetParametersResult(successful=True)
