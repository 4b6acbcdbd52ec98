"""Look up message classes by name and names by class, and add field names of older layouts.

Type names are as in a config (`PositionSetpoint`, `sensor_msgs/Imu`). An unknown name is an error
that lists similar names; the lookup never guesses.

A workspace may build packages that have the names of Obelisk's packages but come from another
release. They replace Obelisk's, and types or fields may be missing in them. The library therefore
imports Obelisk's messages only with `optional_message`: a missing message is an error only when it
is used.
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
"""(message, older field name, current field name)."""


def message_class(name: str) -> type[Any]:
    """Return the Python class of a message type.

    Args:
        name: bare (`PositionSetpoint`) or full (`sensor_msgs/Imu`, `sensor_msgs/msg/Imu`).

    Raises:
        ObeliskMsgError: the type is unknown, or its package is not installed.
    """
    full = resolve_msg_type(name) or _found_in_obelisk(name)
    if full is None:
        near = ", ".join(near_msg_types(name))
        raise ObeliskMsgError(
            f"message type `{name}` is not known" + (f"; similar names: {near}" if near else "")
        )
    package, _, bare = full.split("/")
    try:
        module = importlib.import_module(f"{package}.msg")
    except ModuleNotFoundError as error:
        raise ObeliskMsgError(
            f"message type `{full}`: the package `{package}` is not installed "
            "(compile the packages of a workspace with `obk build`)"
        ) from error
    found: type[Any] | None = getattr(module, bare, None)
    if found is None:
        raise ObeliskMsgError(_missing(package, bare))
    return found


def _found_in_obelisk(name: str) -> str | None:
    """Return the full name of a message that only the installed Obelisk packages have."""
    owner, _, bare = name.replace("/msg/", "/").rpartition("/")
    for package in OBELISK_MESSAGES:
        is_owner = owner in ("", package) and bare[:1].isupper()
        if is_owner and bare in vars(importlib.import_module(f"{package}.msg")):
            return f"{package}/msg/{bare}"
    return None


def optional_message(name: str) -> type[Any]:
    """Return the Python class of one of Obelisk's messages, by its bare name.

    If the installed package has no such message, the result is a placeholder class without
    instances. Instantiating it, or passing it to `require_message`, raises ObeliskMsgError.
    """
    package = next(package for package, names in OBELISK_MESSAGES.items() if name in names)
    module = importlib.import_module(f"{package}.msg")
    found: type[Any] | None = getattr(module, name, None)
    return found or _MissingMessage(name, (), {"__module__": f"{package}.msg"})


def require_message(message: type[Any]) -> type[Any]:
    """Return the class unchanged.

    Raises:
        ObeliskMsgError: its package has no such message.
    """
    if isinstance(message, _MissingMessage):
        raise ObeliskMsgError(_missing(message.__module__.partition(".")[0], message.__name__))
    return message


class _MissingMessage(type):
    """The metaclass of placeholders for messages that are missing in their package."""

    def __call__(cls, *_args: Any, **_fields: Any) -> Any:
        return require_message(cls)


def _missing(package: str, name: str) -> str:
    """Explain why a message is missing and how to get it."""
    text = f"the package `{package}` has no message `{name}`"
    if name not in OBELISK_MESSAGES.get(package, ()):
        return text
    file = importlib.import_module(f"{package}.msg").__file__
    return (
        f"{text}: the package in {Path(file or '').parents[1]} replaces Obelisk's package, which "
        f"has it. Add `msg/{name}.msg` to that package, or remove it from the workspace."
    )


def message_name(message: type[Any]) -> str:
    """Return the full type name of a message class, such as `sensor_msgs/msg/Imu`."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def add_field_aliases() -> None:
    """Add the field names of the other layout to the message classes, as properties."""
    for name, *fields in FIELD_ALIASES:
        message = optional_message(name)
        present = [field for field in fields if hasattr(message, field)]
        for field in fields:
            if field not in present and present:
                setattr(message, field, vars(message)[present[0]])
