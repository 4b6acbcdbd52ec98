"""Messages of recordings decoded by the definitions in the file, which need not be sound.

In: channels, their schemas, bytes. Out: values with the fields as attributes. The library that
decodes takes time without bound over comments and constants, and cuts short what is too long for
the bytes that there are; so it gets fields only, and bytes that refuse to be cut.
"""

import re
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from typing import Any, Final, SupportsIndex

from mcap.records import Channel, Schema
from mcap_ros2.decoder import DecoderFactory

__all__ = ["MessageDecoders"]

_FIELD: Final = re.compile(r"\s*(?P<type>\S+)\s+(?P<name>\w+)\s*(?P<equals>=)?")
_BEGINS_DEFINITION: Final = ("===", "MSG:")


class MessageDecoders:
    """The decoders of one file, each made once."""

    def __init__(self) -> None:
        """Begin with none."""
        self._library = DecoderFactory()
        self._schemas: dict[int, Schema] = {}

    def decoder_of(self, channel: Channel, schema: Schema | None) -> Callable[[bytes], Any] | None:
        """What decodes the messages of a channel; None: they are not in the form of ROS 2.

        Raises:
            Exception: of any kind, as does what is given: the definition or a message is damaged.
        """
        if schema is not None:
            if schema.id not in self._schemas:
                self._schemas[schema.id] = replace(schema, data=_fields_only(schema.data))
            schema = self._schemas[schema.id]
        # It prints what it does not understand, whatever that does to a terminal.
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            decode = self._library.decoder_for(channel.message_encoding, schema)
        return None if decode is None else lambda data: decode(_Uncut(data))


class _Uncut(bytes):
    """Bytes of which nobody gets a stretch that is shorter than it was to be."""

    def __getitem__(self, place: SupportsIndex | slice) -> Any:
        if isinstance(place, slice) and place.stop is not None and place.stop > len(self):
            raise EOFError(f"{place.stop} bytes were expected, there are {len(self)}")
        return super().__getitem__(place)


def _fields_only(definition: bytes) -> bytes:
    """A definition with those that it refers to, without comments, constants and defaults."""
    return "\n".join(map(_field_only, definition.decode().splitlines())).encode()


def _field_only(line: str) -> str:
    code = line.partition("#")[0].rstrip()
    field = None if code.startswith(_BEGINS_DEFINITION) else _FIELD.match(code)
    if field is None:
        return code
    return "" if field["equals"] else f"{field['type']} {field['name']}"
