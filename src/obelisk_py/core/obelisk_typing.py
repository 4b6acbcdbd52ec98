"""Type variables over the Obelisk messages, for annotations and for checks at run time."""

from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_args

from lifecycle_msgs.msg import TransitionEvent
from obelisk_control_msgs.msg import (
    ExecutionFSM,
    PDFeedForward,
    PositionSetpoint,
    VelocityCommand,
)
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import (
    JointEncoders,
    ObkForceSensor,
    ObkFramePose,
    ObkImage,
    ObkImu,
    ObkJointEncoders,
    ObkScan,
    TrueSimState,
)
from obelisk_std_msgs.msg import FloatMultiArray, UInt8MultiArray
from rcl_interfaces.msg import Log, ParameterEvent

__all__ = [
    "ObeliskAllowedMsg",
    "ObeliskControlMsg",
    "ObeliskEstimatorMsg",
    "ObeliskMsg",
    "ObeliskSensorMsg",
    "is_in_bound",
]

ObeliskControlMsg = TypeVar(
    "ObeliskControlMsg",
    bound=PositionSetpoint | PDFeedForward | VelocityCommand | ExecutionFSM,
)
ObeliskEstimatorMsg = TypeVar("ObeliskEstimatorMsg", bound=EstimatedState)
ObeliskSensorMsg = TypeVar(
    "ObeliskSensorMsg",
    bound=JointEncoders
    | ObkJointEncoders
    | ObkImu
    | ObkFramePose
    | ObkForceSensor
    | ObkScan
    | ObkImage
    | TrueSimState,
)
ObeliskMsg = TypeVar(
    "ObeliskMsg",
    bound=PositionSetpoint
    | PDFeedForward
    | VelocityCommand
    | ExecutionFSM
    | EstimatedState
    | JointEncoders
    | ObkJointEncoders
    | ObkImu
    | ObkFramePose
    | ObkForceSensor
    | ObkScan
    | ObkImage
    | TrueSimState
    | FloatMultiArray
    | UInt8MultiArray,
)


def is_in_bound(type_: type[Any], typevar: TypeVar) -> bool:
    """Whether a message class is one of those that a type variable stands for.

    Args:
        type_: the class, `type(msg)`.
        typevar: one of this module's variables.

    Raises:
        ValueError: the type variable has no bound.
    """
    bound = typevar.__bound__
    if bound is None:
        raise ValueError(f"the type variable {typevar} has no bound, expected one with `bound=`")
    return type_ in (get_args(bound) or (bound,))


if TYPE_CHECKING:
    Allowed: TypeAlias = Any
else:
    Allowed = ObeliskMsg.__bound__ | Log | ParameterEvent | TransitionEvent

ObeliskAllowedMsg = TypeVar("ObeliskAllowedMsg", bound=Allowed)
"""The Obelisk messages and those of rclpy's own nodes; kept for existing code."""
