"""Recordings read as arrays, compared with the written data and with an independent decoder."""

import json
import struct
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as EncodingWriter

from obelisk_py.recordings import RecordingError, open_run

BAR = "=" * 80
ARM = f"""# Joints of an arm.
string NAME="arm"
uint8 LIMIT = 7

Stamp header

# Joint positions [rad], shape (n,).
float64[] q
float32 current [A]
# Position [m], then orientation.
float64[3] pose
string[] joint_names
bool ready # whether it can move
Part[] parts
Vec force   # [N]
uint8[] data
int64 last
{BAR}
MSG: demo_msgs/Stamp
builtin_interfaces/Time stamp
string frame_id
{BAR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{BAR}
MSG: demo_msgs/Part
int8 id
float64 weight # [kg]
{BAR}
MSG: demo_msgs/Vec
float64 x
float64 y
"""
# A comment without a unit would hide the unit in the line above.
ARM = ARM.replace("float32 current [A]", "float32 current # [A]")


def arm(number: int, **values: Any) -> dict[str, Any]:
    message = {
        "header": {"stamp": {"sec": number, "nanosec": 5}, "frame_id": "base"},
        "q": [number + 0.25, -number],
        "current": 0.5 * number,
        "pose": [1.0, 2.0, number],
        "joint_names": ["hip", "knee"],
        "ready": number % 2 == 0,
        "parts": [{"id": -3, "weight": 0.5}, {"id": 4, "weight": number}],
        "force": {"x": number, "y": 2.0 * number},
        "data": bytes(number % 3),
        "last": -number,
    }
    return {**message, **values}


def written(path: Path, messages: Iterable[dict[str, Any]]) -> Path:
    with path.open("wb") as file:
        writer = EncodingWriter(file)
        schema = writer.register_msgdef("demo_msgs/msg/Arm", ARM)
        for number, message in enumerate(messages):
            time_ns = 1_000_000_000 + number * 1_000_000
            writer.write_message("/robot/arm", schema, message, time_ns, time_ns - 100)
        writer.finish()
    return path


def by_the_library(path: Path) -> list[Any]:
    with path.open("rb") as file:
        found = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        return [message for *_, message in found]


def test_fields_are_arrays_with_times_names_and_units(tmp_path: Path) -> None:
    run = open_run(written(tmp_path / "a.mcap", map(arm, range(5))))
    topic = run["arm"]
    assert run.topics == ("/robot/arm",)
    assert topic.q.tolist() == [[n + 0.25, -n] for n in range(5)]
    assert topic.t == pytest.approx([n * 1e-3 - 1e-7 for n in range(5)])
    assert topic.received == pytest.approx([n * 1e-3 for n in range(5)])
    assert topic.stamps.tolist() == [n + 5e-9 for n in range(5)]
    assert topic.joint("knee", "q").tolist() == [-n for n in range(5)]
    assert topic["q[knee]"].tolist() == topic["q[1]"].tolist() == [-n for n in range(5)]
    assert topic.ready.tolist() == [True, False, True, False, True]
    assert topic["header.frame_id"].tolist() == ["base"] * 5
    assert topic.force.y.tolist() == [2.0 * n for n in range(5)]
    assert np.asarray(topic.force)[3].tolist() == [3.0, 6.0]
    assert topic["parts[1].weight"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert topic["q[1]"].tolist() == [-n for n in range(5)]
    assert [len(one) for one in topic.data] == [0, 1, 2, 0, 1]
    units = {
        path: topic.unit(path) for path in ("q", "current", "force.x", "pose", "ready", "q[0]")
    }
    assert units == {
        "q": "rad",
        "current": "A",
        "force.x": "N",
        "pose": "",
        "ready": "",
        "q[0]": "rad",
    }
    assert [one.label for one in topic.signals("q")] == ["q[hip]", "q[knee]"]
    assert [one.place for one in topic.signals("q[knee]")] == [1]
    assert [one.label for one in topic.signals("data")] == ["data[0]", "data[1]"]
    (second,) = topic.signals("data[1]")
    assert np.isnan(second.values()).tolist() == [True, True, False, True, True]


def test_a_missing_item_of_a_nested_array_is_nan(tmp_path: Path) -> None:
    limbs = [[{"id": 1, "values": [number, 2.0]}] * (number % 3) for number in range(4)]
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = EncodingWriter(file)
        definition = f"Limb[] limbs\n{'=' * 80}\nMSG: demo_msgs/Limb\nint8 id\nfloat64[] values\n"
        schema = writer.register_msgdef("demo_msgs/msg/Body", definition)
        for number, parts in enumerate(limbs):
            writer.write_message("/body", schema, {"limbs": parts}, number + 1, number + 1)
        writer.finish()
    topic = open_run(path)["/body"]
    expected = [np.nan, np.nan, 2.0, np.nan]
    assert topic["limbs[1].values[0]"].tolist() == pytest.approx(expected, nan_ok=True)
    (signal,) = topic.signals("limbs[1].values[0]")
    assert signal.values().tolist() == pytest.approx(expected, nan_ok=True)
    assert topic.names("q_joints") == ()


LENGTHS = st.lists(
    st.builds(
        lambda number, q, names, parts, data: arm(
            number,
            q=q,
            joint_names=names,
            parts=[{"id": n % 100, "weight": n} for n in range(parts)],
            data=data,
        ),
        st.integers(0, 99),
        st.lists(st.floats(allow_nan=False), max_size=3),
        st.lists(st.text("aä€", max_size=4), max_size=2),
        st.integers(0, 2),
        st.binary(max_size=9),
    ),
    min_size=1,
    max_size=8,
)


@given(LENGTHS)
def test_messages_of_any_lengths_are_those_of_an_independent_decoder(
    tmp_path_factory: pytest.TempPathFactory, messages: list[dict[str, Any]]
) -> None:
    path = written(tmp_path_factory.mktemp("runs") / "a.mcap", messages)
    topic = open_run(path)["arm"]
    for place, theirs in enumerate(by_the_library(path)):
        for name in ("q", "pose", "joint_names", "data"):
            assert list(topic[name][place]) == list(getattr(theirs, name))
        assert topic.last[place] == theirs.last
        assert topic.current[place] == theirs.current
        for number, part in enumerate(theirs.parts):
            assert topic[f"parts[{number}].weight"][place] == part.weight
            assert topic[f"parts[{number}].id"][place] == part.id


def test_messages_in_the_other_order_of_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("demo_msgs/msg/N", "ros2msg", b"int8 a\nfloat64[] b\n")
        channel = writer.register_channel("/n", "cdr", schema)
        big = b"\0\0\0\0" + struct.pack(">b3xId", 1, 1, 2.5)
        little = b"\0\1\0\0" + struct.pack("<b3xId", 2, 1, 3.5)
        for time_ns, data in enumerate((big, little, big)):
            writer.add_message(channel, time_ns + 1, data, time_ns + 1)
        writer.finish()
    assert open_run(path)["/n"].b.tolist() == [[2.5], [3.5], [2.5]]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_any_form_of_the_file_gives_the_messages_in_order_of_receipt(
    compression: CompressionType, use_chunking: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=150, compression=compression, use_chunking=use_chunking)
        writer.start("ros2")
        schema = writer.register_schema("demo_msgs/msg/N", "ros2msg", b"int64 a\n")
        channels = [writer.register_channel(name, "cdr", schema) for name in ("/a", "/b")]
        for number in (5, 1, 9, 2, 8, 3, 7, 4, 6):
            for place, channel in enumerate(channels):
                data = b"\0\1\0\0" + struct.pack("<q", number * 10 + place)
                writer.add_message(channel, number, data, 0)
        writer.finish()
    run = open_run(path)
    assert run["/a"].a.tolist() == [n * 10 for n in range(1, 10)]
    assert run["/b"].a.tolist() == [n * 10 + 1 for n in range(1, 10)]
    assert run["/a"].messages.published_ns.tolist() == list(range(1, 10))
    assert sum(len(part) for part in run.parts(["/a"])) == 9


def test_a_truncated_file_is_read_up_to_its_end(tmp_path: Path) -> None:
    whole = written(tmp_path / "a.mcap", (arm(n, data=bytes(30_000)) for n in range(200)))
    data = whole.read_bytes()
    # The content is compressed, so cut within the chunks.
    whole.write_bytes(data[: int(len(data) * 0.6)])
    run = open_run(whole)
    assert not run.bag.is_complete
    count = run.bag.count
    assert run["arm"].last.tolist() == [-n for n in range(count)] if count else True


def test_times_begin_at_the_activation_that_the_launcher_noted(tmp_path: Path) -> None:
    path = written(tmp_path / "recording.mcap", map(arm, range(3)))
    events = (
        {"time": 1.0, "event": "StackState", "state": "inactive"},
        {"time": 1.5, "event": "StackState", "state": "active"},
        {"time": 1.7, "event": "StackState", "state": "active"},
    )
    lines = [*map(json.dumps, events), '{"time": 3.0, "eve']
    path.with_name("events.jsonl").write_text("\n".join(lines))
    assert open_run(tmp_path)["arm"].received == pytest.approx([-0.5, -0.499, -0.498])


def test_a_run_is_opened_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    for day, count in (("01", 2), ("02", 5)):
        folder = tmp_path / "runs" / f"arm_202603{day}_120000"
        folder.mkdir(parents=True)
        written(folder / "recording.mcap", map(arm, range(count)))
    assert [len(open_run(name)["arm"]) for name in ("arm", "arm~1")] == [5, 2]
    assert open_run("arm").name == "arm_20260302_120000"
    with pytest.raises(RecordingError, match="`leg`"):
        open_run("leg")


@pytest.mark.parametrize(
    ("look", "reported"),
    [
        (lambda run: run["amr"], "available: `/robot/arm`"),
        (lambda run: run["arm"]["qq"], "did you mean `q`"),
        (lambda run: run["arm"]["q[2]"], "has only 2 items"),
        (lambda run: run["arm"]["q[kne]"], r"did you mean `q\[knee\]`"),
        (lambda run: run["arm"]["last[0]"], "is not an array"),
        (lambda run: run["arm"].joint("kne", "q"), "did you mean `knee`"),
        (lambda run: list(run["arm"].signals("forc")), "did you mean `force`"),
    ],
)
def test_a_missing_name_is_reported_with_the_existing_ones(
    look: Any, reported: str, tmp_path: Path
) -> None:
    run = open_run(written(tmp_path / "a.mcap", map(arm, range(2))))
    with pytest.raises(RecordingError, match=reported):
        look(run)


def test_an_attribute_that_no_message_has_is_an_attribute_error(tmp_path: Path) -> None:
    topic = open_run(written(tmp_path / "a.mcap", [arm(1)]))["arm"]
    with pytest.raises(AttributeError, match="no field `speed`"):
        _ = topic.speed
    assert not hasattr(topic.force, "z")


@pytest.mark.parametrize(
    ("definition", "data", "reported"),
    [
        ("uint8[] data\n", struct.pack("<I", 100) + b"few", "expected 100 bytes"),
        ("string data\n", struct.pack("<I", 2**32 - 1), "bytes, only "),
        (f"Id[] data\n{BAR}\nMSG: d/Id\nuint8[16] id\n", b"\xff" * 4, "bytes, only "),
        ("uint8[999999999] data\n", b"", "bytes, only "),
        (f"A a\n{BAR}\nMSG: d/A\nA a\n", bytes(100), "contains itself"),
        ("Gone data\n", bytes(8), "does not define"),
        ("wstring data\n", bytes(8), "wstring"),
        ("float64\n", bytes(8), "invalid line"),
    ],
)
def test_invalid_messages_and_definitions_are_reported(
    tmp_path: Path, definition: str, data: bytes, reported: str
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("d/msg/N", "ros2msg", definition.encode())
        channel = writer.register_channel("/n", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0" + data, 1)
        writer.finish()
    with pytest.raises(RecordingError, match=reported):
        _ = open_run(path)["/n"].fields


def test_it_is_imported_without_ros() -> None:
    code = (
        "import sys; sys.modules['rclpy'] = None; import importlib.util as u; find = u.find_spec;"
        "u.find_spec = lambda name: None if name == 'rclpy' else find(name);"
        "import obelisk_py.recordings;"
        "print([name for name in sys.modules if name.startswith(('rosidl', 'obelisk_control'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
