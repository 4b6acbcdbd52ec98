"""Type variables over the Obelisk messages, for annotations and checks at runtime."""

from functools import cache, reduce
from operator import or_
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_args

from lifecycle_msgs.msg import TransitionEvent
from rcl_interfaces.msg import Log, ParameterEvent

from obelisk_py.core.messages import optional_message
from obelisk_spec.names import OBELISK_MESSAGES

__all__ = [
    "ObeliskAllowedMsg",
    "ObeliskControlMsg",
    "ObeliskEstimatorMsg",
    "ObeliskMsg",
    "ObeliskSensorMsg",
    "is_in_bound",
]


if TYPE_CHECKING:
    Control: TypeAlias = Any
    Estimate: TypeAlias = Any
    Sensed: TypeAlias = Any
    Known: TypeAlias = Any
else:

    def _any_of(*packages: str) -> Any:
        """Return the union of the messages in these packages, including missing ones."""
        names = (name for package in packages for name in OBELISK_MESSAGES[package])
        return reduce(or_, map(optional_message, names))

    Control = _any_of("obelisk_control_msgs")
    Estimate = _any_of("obelisk_estimator_msgs")
    Sensed = _any_of("obelisk_sensor_msgs")
    Known = _any_of(*OBELISK_MESSAGES)

ObeliskControlMsg = TypeVar("ObeliskControlMsg", bound=Control)
ObeliskEstimatorMsg = TypeVar("ObeliskEstimatorMsg", bound=Estimate)
ObeliskSensorMsg = TypeVar("ObeliskSensorMsg", bound=Sensed)
ObeliskMsg = TypeVar("ObeliskMsg", bound=Known)


def is_in_bound(type_: type[Any], typevar: TypeVar) -> bool:
    """Whether a message class is in the bound of a type variable.

    Args:
        type_: the class, `type(msg)`.
        typevar: one of this module's variables.

    Raises:
        ValueError: the type variable has no bound.
    """
    return type_ in _bounds(typevar)


@cache
def _bounds(typevar: TypeVar) -> frozenset[type[Any]]:
    bound = typevar.__bound__
    if bound is None:
        raise ValueError(f"the type variable {typevar} has no bound, expected one with `bound=`")
    return frozenset(get_args(bound) or (bound,))


if TYPE_CHECKING:
    Allowed: TypeAlias = Any
else:
    Allowed = ObeliskMsg.__bound__ | Log | ParameterEvent | TransitionEvent

ObeliskAllowedMsg = TypeVar("ObeliskAllowedMsg", bound=Allowed)
"""The Obelisk messages and the messages of rclpy's own topics; kept for existing code."""
