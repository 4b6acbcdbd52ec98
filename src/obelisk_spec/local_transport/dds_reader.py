"""Take messages from DDS with the GID of their publisher, and look up GIDs of publishers.

rclpy offers neither, so this module calls rcl and Fast DDS, which rclpy has loaded, through ctypes.
Only `rmw_fastrtps_cpp` is supported.

Source: rmw/types.h, rcl/subscription.h, rcutils/types/uint8_array.h of ROS 2 Jazzy.
"""

import ctypes
import functools
import weakref
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["GID_BYTES", "DdsReader", "Sample", "participant_of", "publisher_gid"]

_PREFIX_BYTES: Final = 12
GID_BYTES: Final = 16
_TAKE_FAILED: Final = 401
"""`RCL_RET_SUBSCRIPTION_TAKE_FAILED`: no message is available."""


class _Gid(ctypes.Structure):
    _fields_ = (("implementation", ctypes.c_char_p), ("data", ctypes.c_ubyte * GID_BYTES))


class _MessageInfo(ctypes.Structure):
    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("publisher_gid", _Gid),
        ("from_intra_process", ctypes.c_bool),
    )


class _Allocator(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    )


class _Bytes(ctypes.Structure):
    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )


@dataclass(frozen=True, slots=True)
class _Libraries:
    """The called functions, in libraries that rclpy has already loaded."""

    take: Any
    rmw_publisher: Any
    gid_of: Any
    make_bytes: Any
    free_bytes: Any
    allocator: _Allocator


@functools.cache
def _libraries() -> _Libraries:
    rcl, rmw = ctypes.CDLL("librcl.so"), ctypes.CDLL("librmw_fastrtps_cpp.so")
    rcutils = ctypes.CDLL("librcutils.so")
    take, rmw_publisher = rcl.rcl_take_serialized_message, rcl.rcl_publisher_get_rmw_handle
    take.argtypes = (ctypes.c_void_p,) * 4
    rmw_publisher.argtypes, rmw_publisher.restype = (ctypes.c_void_p,), ctypes.c_void_p
    gid_of = rmw.rmw_get_gid_for_publisher
    gid_of.argtypes = (ctypes.c_void_p,) * 2
    default = rcutils.rcutils_get_default_allocator
    default.restype = _Allocator
    make, free = rcutils.rcutils_uint8_array_init, rcutils.rcutils_uint8_array_fini
    make.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
    free.argtypes = (ctypes.c_void_p,)
    return _Libraries(take, rmw_publisher, gid_of, make, free, default())


def publisher_gid(handle: Any) -> bytes:
    """Return the GID of a publisher.

    Raises:
        InvalidHandle: the publisher was destroyed.
        RuntimeError: the middleware reports an error.
    """
    libraries, gid = _libraries(), _Gid()
    with handle:
        code = libraries.gid_of(libraries.rmw_publisher(handle.pointer), ctypes.byref(gid))
    if code != 0:
        raise RuntimeError(f"rmw_get_gid_for_publisher returned {code}")
    return bytes(gid.data)


def participant_of(gid: bytes) -> bytes:
    """Return the part of a GID that all entities of a ROS context share."""
    return gid[:_PREFIX_BYTES]


@dataclass(frozen=True, slots=True)
class Sample:
    """A message from DDS."""

    data: bytes
    publisher: bytes
    """The GID of its publisher."""
    number: int
    """Its number among the messages of the publisher, from 1."""
    published_ns: int
    """Time of publication [ns since 1970]; `received_ns` has the same unit."""
    received_ns: int


class DdsReader:
    """Takes the messages of one subscription; not thread-safe."""

    def __init__(self, handle: Any) -> None:
        """Keep the subscription alive until `close`.

        Args:
            handle: rclpy's handle of the subscription.

        Raises:
            InvalidHandle: the subscription is already destroyed.
        """
        handle.__enter__()
        self._handle: Any = handle
        libraries = _libraries()
        data, info = _Bytes(), _MessageInfo()
        libraries.make_bytes(ctypes.byref(data), 0, ctypes.byref(libraries.allocator))
        # When the process exits, another thread may still be taking messages.
        weakref.finalize(self, libraries.free_bytes, ctypes.byref(data)).atexit = False
        self._data, self._info, self._take = data, info, libraries.take
        self._arguments = (handle.pointer, ctypes.byref(data), ctypes.byref(info), None)

    def take(self) -> Sample | None:
        """Take the oldest waiting message; None if there is none, or after `close`.

        Raises:
            RuntimeError: the middleware reports an error.
        """
        if self._handle is None:
            return None
        code = self._take(*self._arguments)
        if code == _TAKE_FAILED:
            return None
        if code != 0:
            raise RuntimeError(f"rcl_take_serialized_message returned {code}")
        data, info = self._data, self._info
        return Sample(
            ctypes.string_at(data.buffer, data.length),
            bytes(info.publisher_gid.data),
            info.publication_sequence_number,
            info.source_timestamp,
            info.received_timestamp,
        )

    def close(self) -> None:
        """Release the subscription, so that it can be destroyed."""
        if self._handle is not None:
            self._handle.__exit__(None, None, None)
            self._handle = None
