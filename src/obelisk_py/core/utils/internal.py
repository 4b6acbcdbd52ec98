"""Look up message classes by name; kept for existing code."""

import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any, TypeVar, get_args

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.messages import message_class
from obelisk_spec.names import bare_name
from obelisk_spec.suggestions import did_you_mean

__all__ = ["check_and_get_obelisk_msg_type", "get_classes_in_module"]


def get_classes_in_module(module: ModuleType) -> list[type[Any]]:
    """Return the classes that a module and its submodules define, sorted by name."""
    inside = f"{module.__name__}."
    classes = (value for _, value in inspect.getmembers(module, inspect.isclass))
    return [found for found in classes if f"{found.__module__}.".startswith(inside)]


def check_and_get_obelisk_msg_type(msg_type_name: str, msg_module_or_type: Any = None) -> type[Any]:
    """Return the message class with this name.

    Args:
        msg_type_name: bare (`PositionSetpoint`) or full (`sensor_msgs/msg/Imu`).
        msg_module_or_type: the allowed classes: a module, a class, a union, a type variable, or a
            list of these; None allows any class.

    Raises:
        ObeliskMsgError: the class does not exist or is not allowed.
    """
    if msg_module_or_type is None:
        return message_class(msg_type_name)
    allowed = {found.__name__: found for found in _classes(msg_module_or_type)}
    found = allowed.get(bare_name(msg_type_name))
    if found is None:
        hint = did_you_mean(msg_type_name, sorted(allowed)) or "none is"
        raise ObeliskMsgError(f"message type `{msg_type_name}` is not allowed here; {hint}")
    return found


def _classes(source: Any) -> Iterator[type[Any]]:
    if isinstance(source, ModuleType):
        yield from get_classes_in_module(source)
    elif isinstance(source, TypeVar):
        yield from _classes(source.__bound__ or source.__constraints__)
    elif isinstance(source, type):
        yield source
    else:
        for part in get_args(source) or source:
            yield from _classes(part)
