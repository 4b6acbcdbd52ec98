"""The stamp in a message: where it is by the message's type, and what it says [ns]."""

from collections.abc import Callable
from typing import Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.looking.selection import FieldsOf

__all__ = ["stamp_of"]

HEADER: Final = "std_msgs/Header"
TIME: Final = "builtin_interfaces/Time"
NS: Final = 1_000_000_000


def stamp_of(msg_type: str, fields_of: FieldsOf) -> Callable[[Any], int]:
    """What takes the stamp [ns] out of messages of a type.

    Args:
        msg_type: `pkg/Name`.
        fields_of: where types are looked up.

    Raises:
        CommandFailedError: such messages have none.
    """
    fields = fields_of(msg_type)
    header = next((name for name, kind in fields.items() if kind == HEADER), None)
    if header is not None:
        return lambda message: _ns(getattr(message, header).stamp)
    time = next((name for name, kind in fields.items() if kind == TIME), None)
    if time is None:
        raise CommandFailedError(
            f"{msg_type} has no header and no stamp, so nothing tells when a message was made"
        )
    return lambda message: _ns(getattr(message, time))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NS + int(stamp.nanosec)
