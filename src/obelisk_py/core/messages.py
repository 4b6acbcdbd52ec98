"""Look up message classes by name and names by class, and add field names of older layouts.

Takes what a config writes (`PositionSetpoint`, `sensor_msgs/Imu`) and gives the Python class;
never guesses: a name that is not known is an error that lists near ones.
"""

import importlib
from typing import Any

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_spec.names import near_msg_types, resolve_msg_type

__all__ = ["add_field_aliases", "message_class", "message_name"]

FIELD_ALIASES: tuple[tuple[type[Any], str, str], ...] = (
    (PositionSetpoint, "u", "u_mujoco"),
    (EstimatedState, "x_hat", "q_joints"),
)
"""(message class, older field name, field that now holds it)."""


def message_class(name: str) -> type[Any]:
    """The Python class of a message type.

    Args:
        name: bare (`PositionSetpoint`) or full (`sensor_msgs/Imu`, `sensor_msgs/msg/Imu`).

    Raises:
        ObeliskMsgError: no such type is known, or its package is not installed.
    """
    full = resolve_msg_type(name)
    if full is None:
        near = ", ".join(near_msg_types(name))
        raise ObeliskMsgError(
            f"message type `{name}` is not known" + (f"; near names: {near}" if near else "")
        )
    package, _, bare = full.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), bare)  # type: ignore[no-any-return]
    except ModuleNotFoundError as error:
        raise ObeliskMsgError(
            f"message type `{full}`: the package `{package}` is not installed "
            "(those of a workspace are compiled by `obk build`)"
        ) from error
    except AttributeError as error:
        raise ObeliskMsgError(f"the package `{package}` has no message `{bare}`") from error


def message_name(message: type[Any]) -> str:
    """The full type name of a message class, `sensor_msgs/msg/Imu`."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def add_field_aliases() -> None:
    """Give the message classes properties under the field names of their older layouts."""
    for message, older, field in FIELD_ALIASES:
        setattr(message, older, _alias(field))


def _alias(field: str) -> property:
    def get(message: Any) -> Any:
        return getattr(message, field)

    def put(message: Any, value: Any) -> None:
        setattr(message, field, value)

    return property(get, put, doc=f"Older name of `{field}`.")
