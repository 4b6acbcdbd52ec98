"""How large the numbers of a config may be: what the machinery behind them can hold. Data only."""

from typing import Final

__all__ = ["LARGEST_COUNT", "LONGEST_PERIOD_S", "SHORTEST_PERIOD_S"]

LARGEST_COUNT: Final = 2**31 - 1
"""Depths of DDS, sizes of MuJoCo and device numbers have 32 bits.

Source: OMG, Data Distribution Service 1.4, HistoryQosPolicy; MuJoCo, mjModel.
"""

SHORTEST_PERIOD_S: Final = 1e-9
LONGEST_PERIOD_S: Final = 9e9
"""ROS counts time in 64 bits of nanoseconds [s]."""
