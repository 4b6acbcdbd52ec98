"""Load message and service classes, and their type support, by name."""

import ctypes
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
    "opaque_type",
    "raw_type",
    "require_message",
    "require_service",
    "short_type",
]


def require_message(python_type: Any) -> None:
    """Check that messages of a class can be sent and received.

    Raises:
        CommandFailedError: its type support cannot be loaded.
    """
    from rclpy.type_support import check_is_valid_msg_type

    _require(check_is_valid_msg_type, python_type)


def require_service(python_type: Any) -> None:
    """Check that services of a class can be called.

    Raises:
        CommandFailedError: its type support cannot be loaded.
    """
    from rclpy.type_support import check_is_valid_srv_type

    _require(check_is_valid_srv_type, python_type)


def _require(check: Callable[[Any], Any], python_type: Any) -> None:
    try:
        check(python_type)
    except Exception as error:  # generated packages may raise anything
        package, section, *_ = f"{python_type.__module__}.".split(".")
        raise CommandFailedError(
            f"the type {package}/{section}/{python_type.__name__} cannot be used here: {error}",
            help="its package was built for another Python or ROS 2: build it again, or remove it "
            "from PYTHONPATH",
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
    except Exception as error:  # generated packages may raise anything
        raise CommandFailedError(
            f"the type {name} cannot be loaded ({error})",
            help=f"if `{package}` is in a workspace, run `obk build {package}` there; "
            "otherwise install it, or source the workspace that contains it",
        ) from error
    found = getattr(module, kind, None)
    if not isinstance(found, type):
        known = [one for one in vars(module) if one[:1].isupper() and "_" not in one]
        raise CommandFailedError(
            f"the package {package} has no type {name}", help=did_you_mean(kind, known)
        )
    return found


def _import_section(package: str, section: str) -> ModuleType:
    """Import the messages of a package, and nothing else with such a name.

    Names come from any node in the ROS graph, and importing a module runs it.

    Raises:
        ImportError: no package with such messages exists.
        Exception: anything that a generated package raises.
    """
    spec = importlib.util.find_spec(package) if package.isidentifier() else None
    folders = (spec.submodule_search_locations or ()) if spec else ()
    if section not in SECTIONS or not any(Path(one, section).is_dir() for one in folders):
        raise ImportError(f"no package `{package}` with messages")
    return importlib.import_module(f"{package}.{section}")


def raw_type(name: str, hashes: Iterable[str]) -> Any:
    """The class for counting messages, even if the type is not built here.

    Args:
        name: full, `pkg/msg/Name`.
        hashes: type hashes announced by publishers.

    Raises:
        CommandFailedError: the type is not built here, and the middleware requires it.
    """
    try:
        python_type = find_type(name)
        require_message(python_type)
    except CommandFailedError:
        return opaque_type(name, max(hashes, default=""))
    return python_type


def short_type(name: str) -> str:
    """`pkg/Name` for `pkg/msg/Name`, as in field types; other names are unchanged."""
    return name.replace("/msg/", "/")


def fields_of(name: str) -> Mapping[str, str]:
    """The names and types of a message's fields, by `pkg/Name` or a full name.

    Raises:
        CommandFailedError: see `find_type`.
    """
    fields: Mapping[str, str] = find_type(name).get_fields_and_field_types()
    return fields


def make_message(name: str, data: Data) -> Any:
    """Create a message with these fields, and defaults for the others.

    Args:
        name: `pkg/Name`, or a full name.
        data: checked against the type; `Now` is replaced by the current time.
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


FAST_DDS: Final = b"rosidl_typesupport_fastrtps_c"
CONVERSIONS: Final = (
    "_CREATE_ROS_MESSAGE",
    "_CONVERT_FROM_PY",
    "_CONVERT_TO_PY",
    "_DESTROY_ROS_MESSAGE",
)
HASH_PREFIX: Final = "RIHS01_"


class _Support(ctypes.Structure):
    """`rosidl_message_type_support_t`."""

    _fields_ = (
        ("identifier", ctypes.c_char_p),
        ("data", ctypes.c_void_p),
        ("find", ctypes.c_void_p),
        ("hash", ctypes.c_void_p),
        ("description", ctypes.c_void_p),
        ("sources", ctypes.c_void_p),
    )


class _Callbacks(ctypes.Structure):
    """`message_type_support_callbacks_t`."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("serialize", ctypes.c_void_p),
        ("deserialize", ctypes.c_void_p),
        ("size", ctypes.c_void_p),
        ("greatest_size", ctypes.c_void_p),
        ("keys", ctypes.c_void_p),
    )


class _Hash(ctypes.Structure):
    """`rosidl_type_hash_t`."""

    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


_GiveHash: Final = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
_Find: Final = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
_made: Final[dict[str, Any]] = {}
"""By name; never freed, because the middleware keeps pointers into them."""


def opaque_type(name: str, type_hash: str) -> Any:
    """A stand-in class for messages whose type is not built here, for raw subscriptions.

    Args:
        name: full, `pkg/msg/Name`.
        type_hash: as announced by publishers.

    Raises:
        CommandFailedError: the middleware needs more than a type's name, or it is not a ROS 2 type.
    """
    if name not in _made:
        _made[name] = _make_opaque(name, type_hash)
    return _made[name]


def _make_opaque(name: str, type_hash: str) -> Any:
    from std_msgs.msg import String

    String.__class__.__import_type_support__()
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    general = pointer(String.__class__._TYPE_SUPPORT, None)
    found = _Find(_Support.from_address(general).find)(general, FAST_DDS)
    if not found:
        raise CommandFailedError(f"the type {name} is not built here, which only Fast DDS supports")
    package, section, kind = _parts(name)
    special = _copy(_Support, found)
    callbacks = _copy(_Callbacks, special.data)
    callbacks.namespace = f"{package}::{section}".encode()
    callbacks.name = kind.encode()
    its_hash = _Hash(1, (ctypes.c_uint8 * 32)(*_digest(type_hash)))
    give_hash = _GiveHash(lambda _: ctypes.addressof(its_hash))
    special.data = ctypes.addressof(callbacks)
    special.hash = ctypes.cast(give_hash, ctypes.c_void_p).value
    support = _copy(_Support, general)
    support.hash = special.hash
    others = _Find(support.find)

    def find(_: int, identifier: bytes) -> int | None:
        # All other fields, such as the structure of the type, come from the other type.
        is_special = identifier == FAST_DDS
        address: int | None = others(general, identifier)
        return ctypes.addressof(special) if is_special else address

    finds = _Find(find)
    support.find = ctypes.cast(finds, ctypes.c_void_p).value
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype = ctypes.py_object
    capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    meta = type(
        "StandIn",
        (type,),
        {
            "_TYPE_SUPPORT": capsule(ctypes.addressof(support), None, None),
            # rclpy requires them, but a message that stays serialized is never converted.
            **dict.fromkeys(CONVERSIONS, NotImplemented),
            "kept": (support, special, callbacks, its_hash, give_hash, finds),
        },
    )
    return meta(kind, (), {})


def _parts(name: str) -> list[str]:
    """Package, section and name; other DDS programs may use other forms."""
    parts = name.split("/")
    if len(parts) != 3:
        raise CommandFailedError(f"`{name}` is not a ROS 2 type")
    return parts


def _digest(type_hash: str) -> bytes:
    """The 32 bytes of a hash; zeros if there is none, as in older ROS 2 versions."""
    is_reported = type_hash.startswith(HASH_PREFIX)
    return bytes.fromhex(type_hash.removeprefix(HASH_PREFIX)) if is_reported else bytes(32)


def _copy(kind: Any, address: int | None) -> Any:
    """Copy the object at an address into our own memory."""
    return kind.from_buffer_copy(ctypes.string_at(address or 0, ctypes.sizeof(kind)))
