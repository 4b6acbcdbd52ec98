"""What a ROS parameter can hold.

Source: rcl_interfaces/msg/ParameterType, without byte arrays.
"""

__all__ = ["ParameterValue"]

ParameterValue = (
    bool
    | int
    | float
    | str
    | tuple[bool, ...]
    | tuple[int, ...]
    | tuple[float, ...]
    | tuple[str, ...]
)
