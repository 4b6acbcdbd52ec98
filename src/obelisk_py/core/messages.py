"""Look up message classes by name and names by class, and add field names of older layouts.

Takes what a config writes (`PositionSetpoint`, `sensor_msgs/Imu`) and gives the Python class;
never guesses: a name that is not known is an error that lists near ones.

A workspace may build packages with the names of Obelisk's, of another release: they replace
Obelisk's, and a type or a field may be missing in them. The library imports Obelisk's messages by
`optional_message` only, so that a missing one is an error where it is used.
"""

import importlib
from pathlib import Path
from typing import Any

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_spec.names import OBELISK_MESSAGES, near_msg_types, resolve_msg_type

__all__ = [
    "add_field_aliases",
    "message_class",
    "message_name",
    "optional_message",
    "require_message",
]

FIELD_ALIASES: tuple[tuple[str, str, str], ...] = (
    ("PositionSetpoint", "u", "u_mujoco"),
    ("EstimatedState", "x_hat", "q_joints"),
)
"""(message, older field name, field that now holds it)."""


def message_class(name: str) -> type[Any]:
    """The Python class of a message type.

    Args:
        name: bare (`PositionSetpoint`) or full (`sensor_msgs/Imu`, `sensor_msgs/msg/Imu`).

    Raises:
        ObeliskMsgError: no such type is known, or its package is not installed.
    """
    full = resolve_msg_type(name) or _found_in_obelisk(name)
    if full is None:
        near = ", ".join(near_msg_types(name))
        raise ObeliskMsgError(
            f"message type `{name}` is not known" + (f"; near names: {near}" if near else "")
        )
    package, _, bare = full.split("/")
    try:
        module = importlib.import_module(f"{package}.msg")
    except ModuleNotFoundError as error:
        raise ObeliskMsgError(
            f"message type `{full}`: the package `{package}` is not installed "
            "(those of a workspace are compiled by `obk build`)"
        ) from error
    found: type[Any] | None = getattr(module, bare, None)
    if found is None:
        raise ObeliskMsgError(_missing(package, bare))
    return found


def _found_in_obelisk(name: str) -> str | None:
    """The full name of a message that only the Obelisk packages in use have."""
    owner, _, bare = name.replace("/msg/", "/").rpartition("/")
    for package in OBELISK_MESSAGES:
        is_owner = owner in ("", package) and bare[:1].isupper()
        if is_owner and bare in vars(importlib.import_module(f"{package}.msg")):
            return f"{package}/msg/{bare}"
    return None


def optional_message(name: str) -> type[Any]:
    """The Python class of one of Obelisk's messages, by its bare name.

    If the package in use has no such message: a class that no message is an instance of. Making an
    instance, and `require_message`, raise ObeliskMsgError.
    """
    package = next(package for package, names in OBELISK_MESSAGES.items() if name in names)
    module = importlib.import_module(f"{package}.msg")
    found: type[Any] | None = getattr(module, name, None)
    return found or _MissingMessage(name, (), {"__module__": f"{package}.msg"})


def require_message(message: type[Any]) -> type[Any]:
    """The class itself.

    Raises:
        ObeliskMsgError: its package has no such message.
    """
    if isinstance(message, _MissingMessage):
        raise ObeliskMsgError(_missing(message.__module__.partition(".")[0], message.__name__))
    return message


class _MissingMessage(type):
    """The type of classes that stand for messages that their package does not have."""

    def __call__(cls, *_args: Any, **_fields: Any) -> Any:
        return require_message(cls)


def _missing(package: str, name: str) -> str:
    """Why a message is missing, and how to get it."""
    text = f"the package `{package}` has no message `{name}`"
    if name not in OBELISK_MESSAGES.get(package, ()):
        return text
    file = importlib.import_module(f"{package}.msg").__file__
    return (
        f"{text}: the package in {Path(file or '').parents[1]} replaces the one of Obelisk, which "
        f"has it. Add `msg/{name}.msg` to that package, or remove it from the workspace."
    )


def message_name(message: type[Any]) -> str:
    """The full type name of a message class, `sensor_msgs/msg/Imu`."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def add_field_aliases() -> None:
    """Give the message classes properties under the field names of the other layout."""
    for name, *fields in FIELD_ALIASES:
        message = optional_message(name)
        present = [field for field in fields if hasattr(message, field)]
        for field in fields:
            if field not in present and present:
                setattr(message, field, _alias(present[0]))


def _alias(field: str) -> property:
    def get(message: Any) -> Any:
        return getattr(message, field)

    def put(message: Any, value: Any) -> None:
        setattr(message, field, value)

    return property(get, put, doc=f"Other name of `{field}`.")
