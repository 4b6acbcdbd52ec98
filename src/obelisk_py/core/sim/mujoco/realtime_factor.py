"""The ROS parameter `realtime_factor`: what it may be.

In: a value. Out: the factor, or why there is none. It is read at configure: the schedule, the
cameras and the promised rate are made from it.
"""

import math
from typing import Final

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["REALTIME_FACTOR", "realtime_factor_of"]

REALTIME_FACTOR: Final = "realtime_factor"


def realtime_factor_of(value: object) -> float:
    """Simulation time over wall time; 0: as fast as possible.

    Raises:
        ObeliskConfigError: the value is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ObeliskConfigError(f"the parameter `{REALTIME_FACTOR}` is {value!r}, no number")
    if not (math.isfinite(value) and value >= 0):
        raise ObeliskConfigError(
            f"the parameter `{REALTIME_FACTOR}` is {value:g}; expected a number above 0, or 0 "
            "for as fast as possible"
        )
    return float(value)
