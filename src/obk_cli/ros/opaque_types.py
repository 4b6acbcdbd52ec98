"""Message types that are not built here, for subscriptions that never look into a message.

Fast DDS matches ends by the type's name. So a type of no other content than its name does to take
serialized messages: it is made from another one's support, of a size without bound as they may be.
Source: rosidl_runtime_c/message_type_support_struct.h, rosidl_typesupport_fastrtps_cpp/
message_type_support.h, rmw_fastrtps_cpp/src/type_support_common.cpp (Jazzy).
"""

import ctypes
from typing import Any, Final

from obk_cli.errors import CommandFailedError

__all__ = ["stand_in"]

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
"""By name; what the middleware keeps pointers into must not go."""


def stand_in(name: str, type_hash: str) -> Any:
    """What a raw subscription takes for the class of a message that is not built here.

    Args:
        name: full, `pkg/msg/Name`.
        type_hash: as publishers tell it.

    Raises:
        CommandFailedError: the middleware is none that does with a type's name, or it is none of
            ROS 2.
    """
    if name not in _made:
        _made[name] = _made_up(name, type_hash)
    return _made[name]


def _made_up(name: str, type_hash: str) -> Any:
    from std_msgs.msg import String

    String.__class__.__import_type_support__()
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    general = pointer(String.__class__._TYPE_SUPPORT, None)
    found = _Find(_Support.from_address(general).find)(general, FAST_DDS)
    if not found:
        raise CommandFailedError(
            f"the type {name} is not built here, and only Fast DDS can do without it"
        )
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
        # What it asks for beside, the make-up of the type, is the other one's.
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
            # rclpy wants them to be there; nobody converts a message that stays serialized.
            **dict.fromkeys(CONVERSIONS, NotImplemented),
            "kept": (support, special, callbacks, its_hash, give_hash, finds),
        },
    )
    return meta(kind, (), {})


def _parts(name: str) -> list[str]:
    """Package, section and name, as other DDS programs need not have them."""
    parts = name.split("/")
    if len(parts) != 3:
        raise CommandFailedError(f"`{name}` is no type of ROS 2")
    return parts


def _digest(type_hash: str) -> bytes:
    """The 32 bytes of a hash; zeros where none is told, as by an older ROS 2."""
    is_told = type_hash.startswith(HASH_PREFIX)
    return bytes.fromhex(type_hash.removeprefix(HASH_PREFIX)) if is_told else bytes(32)


def _copy(kind: Any, address: int | None) -> Any:
    """What lies at an address, in memory of our own."""
    return kind.from_buffer_copy(ctypes.string_at(address or 0, ctypes.sizeof(kind)))
