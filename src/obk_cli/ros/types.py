"""Load message and service classes, and their type support, by name."""

import importlib.util
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError
from obk_cli.ros.field_path import ArrayType, FieldType, Message, Number, parse_type
from obk_cli.ros.message_data import Data, Now

__all__ = [
    "fields_of",
    "find_type",
    "make_message",
    "raw_type",
    "require_message",
    "require_service",
    "short_type",
]


def require_message(python_type: Any) -> None:
    """Make sure that messages of a class can be sent and heard.

    Raises:
        CommandFailedError: they cannot.
    """
    from rclpy.type_support import check_is_valid_msg_type

    _require(check_is_valid_msg_type, python_type)


def require_service(python_type: Any) -> None:
    """Make sure that services of a class can be called.

    Raises:
        CommandFailedError: they cannot.
    """
    from rclpy.type_support import check_is_valid_srv_type

    _require(check_is_valid_srv_type, python_type)


def _require(check: Callable[[Any], Any], python_type: Any) -> None:
    try:
        check(python_type)
    except Exception as error:  # whatever a generated package may raise
        package, section, *_ = f"{python_type.__module__}.".split(".")
        raise CommandFailedError(
            f"the type {package}/{section}/{python_type.__name__} cannot be used here: {error}",
            help="its package is built for another Python or ROS 2: build it anew, or leave that "
            "out of PYTHONPATH",
        ) from error


NS: int = 1_000_000_000
SECTIONS: Final = ("msg", "srv", "action")


def find_type(name: str) -> Any:
    """The class of `pkg/msg/Name` or `pkg/srv/Name`.

    Raises:
        CommandFailedError: its package is not built for this Python, or has no such type.
    """
    package, _, rest = name.partition("/")
    section, _, kind = rest.rpartition("/")
    try:
        module = _import_section(package, section or "msg")
    except Exception as error:  # whatever a generated package may raise
        raise CommandFailedError(
            f"the type {name} is not here ({error})",
            help=f"where `{package}` is a package of a workspace: `obk build {package}` in it; "
            "else install it, or source the workspace that has it",
        ) from error
    found = getattr(module, kind, None)
    if not isinstance(found, type):
        known = [one for one in vars(module) if one[:1].isupper() and "_" not in one]
        raise CommandFailedError(
            f"the package {package} has no type {name}", help=did_you_mean(kind, known)
        )
    return found


def _import_section(package: str, section: str) -> ModuleType:
    """Import the messages of a package, and nothing else that goes by such a name.

    Names come from whoever is in the ROS graph, and importing a module runs it.

    Raises:
        ImportError: there is no package with such messages.
        Exception: whatever a generated package raises.
    """
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    folders = (spec.submodule_search_locations or ()) if spec else ()
    if section not in SECTIONS or not any(Path(one, section).is_dir() for one in folders):
        raise ImportError(f"no package `{package}` with messages")
    return importlib.import_module(f"{package}.{section}")


def raw_type(name: str, hashes: Iterable[str]) -> Any:
    """The class of a message that is only to be counted; one that is not built here does too.

    Args:
        name: full, `pkg/msg/Name`.
        hashes: of the type, as publishers tell them.

    Raises:
        CommandFailedError: it is not built here, and the middleware cannot do without.
    """
    try:
        python_type = find_type(name)
        require_message(python_type)
    except CommandFailedError:
        from obk_cli.ros.opaque_types import stand_in

        return stand_in(name, max(hashes, default=""))
    return python_type


def short_type(name: str) -> str:
    """`pkg/Name` of `pkg/msg/Name`, as fields name their types; others as they are."""
    return name.replace("/msg/", "/")


def fields_of(name: str) -> Mapping[str, str]:
    """The names and types of a message's fields, by `pkg/Name` or a full name.

    Raises:
        CommandFailedError: see `find_type`.
    """
    fields: Mapping[str, str] = find_type(name).get_fields_and_field_types()
    return fields


def make_message(name: str, data: Data) -> Any:
    """A message of a type with these fields, the others as they are by default.

    Args:
        name: `pkg/Name`, or a full name.
        data: checked against the type; times that are to be the present are the present.
    """
    message = find_type(name)()
    if data is Now.NOW:
        message.sec, message.nanosec = divmod(time.time_ns(), NS)
    elif isinstance(data, dict):
        fields = fields_of(name)
        for field, value in data.items():
            setattr(message, field, _value(value, parse_type(fields[field])))
    return message


def _value(data: Data, kind: FieldType) -> Any:
    match kind:
        case Message(name):
            return make_message(name, data)
        case ArrayType(item) if isinstance(data, list):
            return [_value(one, item) for one in data]
        case Number("octet") if isinstance(data, int):
            return bytes([data])
    return data
