"""Truncated, changed or invented recordings are read, read in part, or rejected with a message."""

import struct
import tempfile
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.run import open_run
from obelisk_recordings.summary import read_bag
from obk_cli.cli.bag import bag_data, bag_text
from obk_cli.errors import ObkError
from obk_cli.introspect.message_text import json_line
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.plot import parse_field, plot_parts

from .hostile import SPOILT, assert_shows_only_text, damaged

TYPE = "demo_msgs/msg/Reading"
DEFINITION = (
    "float64 data\nstring name\nPart[] parts\n" + "=" * 80 + "\nMSG: demo_msgs/Part\nint8[] x\n"
)
MESSAGE = b"\0\1\0\0" + struct.pack("<dI4sIIb", 1.5, 4, b"arm\0", 1, 1, 7)


@cache
def seeds() -> tuple[bytes, ...]:
    """A finished and an unfinished recording by obk, and one with all features of the format."""
    with tempfile.TemporaryDirectory() as folder:
        own, other = Path(folder, "own.mcap"), Path(folder, "other.mcap")
        with BagWriter(own) as writer:
            writer.describe({"obelisk": {"run": "arm"}}, {"plan.json": "{}"}, 1)
            channel = writer.add_topic("/speed", TYPE, DEFINITION, {"topic_type_hash": "RIHS01_0"})
            for number in range(4):
                writer.add_message(channel, MESSAGE, number + 1, number, number + 1)
        with other.open("wb") as file:
            made = Writer(file, compression=CompressionType.ZSTD)
            made.start("ros2", "test")
            schema = made.register_schema(TYPE, "ros2msg", DEFINITION.encode())
            channel = made.register_channel("/speed", "cdr", schema)
            made.add_message(channel, 5, MESSAGE, 5)
            made.add_metadata("m", {"a": "b"})
            made.add_attachment(1, 1, "a", "text/plain", b"attached")
            made.finish()
        ended = own.read_bytes()
        return ended, ended[: len(ended) // 2], other.read_bytes()


def look_at(data: bytes) -> None:
    """Run `obk bag info` and `obk plot` on a file."""
    with tempfile.NamedTemporaryFile(suffix=".mcap") as file:
        file.write(data)
        file.flush()
        path = Path(file.name)
        try:
            bag = read_bag(path)
        except RecordingError:
            return
        assert_shows_only_text(list(bag_text(bag)))
        json_line(bag_data(bag))
        with suppress(ObkError, RecordingError):
            run = open_run(path)
            for topic in run.read(run.topics).values():
                for field in topic.fields:
                    assert len(topic[field]) == len(topic)
                for signal in topic.signals():
                    assert len(signal.values()) == len(topic)
            plot_parts([run], [parse_field("/speed.data")])


@given(st.binary(max_size=200).map(lambda data: b"\x89MCAP0\r\n" + data) | st.binary())
def test_a_file_of_any_bytes_is_read_or_rejected(data: bytes) -> None:
    look_at(data)


@given(st.deferred(lambda: damaged(seeds())))
def test_a_damaged_recording_is_read_or_rejected(data: bytes) -> None:
    look_at(data)


def test_times_that_no_clock_shows_are_read(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    with path.open("wb") as file:
        made = Writer(file, compression=CompressionType.NONE)
        made.start("ros2", "test")
        schema = made.register_schema(TYPE, "ros2msg", DEFINITION.encode())
        channel = made.register_channel("/speed", "cdr", schema)
        made.add_message(channel, 2**64 - 1, MESSAGE, 2**64 - 1)
        made.finish()
    look_at(path.read_bytes())
    assert len(open_run(path)["/speed"].t) == 1


def made_up(topic: str, definition: str, name: str, message: bytes) -> bytes:
    """A valid file with an invalid schema or content."""
    file = BytesIO()
    made = Writer(file, compression=CompressionType.NONE)
    made.start("ros2", name)
    schema = made.register_schema(TYPE, "ros2msg", definition.encode(errors="replace"))
    channel = made.register_channel(topic, "cdr", schema, {"topic_type_hash": name})
    made.add_message(channel, 5, message, 5)
    made.add_metadata(name, {name: name})
    made.finish()
    return file.getvalue()


@given(
    st.just("/speed") | SPOILT,
    damaged([DEFINITION.encode()]).map(lambda data: data.decode(errors="replace")) | st.text(),
    SPOILT,
    damaged([MESSAGE]) | st.binary(),
)
def test_definitions_and_messages_of_any_bytes_are_read_or_rejected(
    topic: str, definition: str, name: str, message: bytes
) -> None:
    look_at(made_up(topic, definition, name, message))
