"""`obk export`: the tables have the content of the recording."""

import csv
import json
import struct
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from obelisk_py.recordings import open_run
from obk_cli.cli.main import main
from obk_cli.record.mcap_writer import BagWriter

SECOND = 1_000_000_000
DEFINITION = """\
# Positions [rad].
float64[] q
string[] joint_names
bool ready
int64 t
string note
"""


def packed(number: int, note: str) -> bytes:
    """Three joints in every fourth message, otherwise two."""
    names = ("hip", "knee", "toe")[: 3 if number % 4 == 3 else 2]
    data = struct.pack(
        f"<I4x{len(names)}d", len(names), *(number + n / 4 for n in range(len(names)))
    )
    data += struct.pack("<I", len(names))
    for name in names:
        data += bytes(-len(data) % 4) + struct.pack("<I", len(name) + 1) + name.encode() + b"\0"
    data += struct.pack("<?", number % 2 == 0)
    data += bytes(-len(data) % 8) + struct.pack("<q", -number)
    return b"\0\1\0\0" + data + struct.pack("<I", len(note) + 1) + note.encode() + b"\0"


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    path = tmp_path / "arm.mcap"
    with BagWriter(path) as writer:
        joints = writer.add_topic("/arm/joints", "demo_msgs/msg/Joints", DEFINITION, {})
        writer.add_topic("/arm/silent", "demo_msgs/msg/Joints", DEFINITION, {})
        speed = writer.add_topic("/arm/speed", "std_msgs/msg/Float64", "float64 data\n", {})
        for number in range(40):
            time_ns = SECOND + number * 1_000_000
            writer.add_message(joints, packed(number, "x" * (number % 3)), time_ns, time_ns, 1)
            data = b"\0\1\0\0" + struct.pack("<d", number)
            writer.add_message(speed, data, time_ns, time_ns, 1)
    return path


def obk(*words: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_parquet_contains_the_messages(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert obk("export", recording, "--to", "parquet") == 0
    lines = ("arm/arm.joints.parquet  40 messages", "arm/arm.speed.parquet  40 messages")
    assert sorted(capsys.readouterr().out.splitlines()) == list(lines)
    topic = open_run(recording)["joints"]
    table = pyarrow.parquet.read_table("arm/arm.joints.parquet")
    found = table.to_pydict()
    for field, column in (("q", "q"), ("joint_names", "joint_names")):
        assert found[column] == [list(row) for row in topic[field]]
    for field, column in (("ready", "ready"), ("t", "t_"), ("note", "note")):
        assert found[column] == topic[field].tolist()
    assert found["t"] == topic.t.tolist()
    assert found["published_ns"] == topic.messages.published_ns.tolist()
    assert table.schema.field("q").metadata[b"unit"] == b"rad"
    assert json.loads(table.schema.metadata[b"obelisk"])["topic"] == "/arm/joints"
    assert [path.name for path in Path("arm").iterdir() if path.name.startswith(".")] == []


def test_csv_has_a_column_for_each_number_called_after_its_joint(recording: Path) -> None:
    assert obk("export", recording, "--to", "csv", "--topic", "joints", "-o", "tables") == 0
    assert [path.name for path in Path("tables").iterdir()] == ["arm.joints.csv"]
    with Path("tables/arm.joints.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    topic = open_run(recording)["joints"]
    for place in range(3):
        column = [float(row[f"q[{place}]"] or "nan") for row in rows]
        np.testing.assert_array_equal(column, topic[f"q[{place}]"])
    assert [row["ready"] for row in rows] == [str(one).lower() for one in topic.ready]
    assert [int(row["t_"]) for row in rows] == topic["t"].tolist()


def test_a_large_recording_is_written_in_parts(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obelisk_recordings.chunks.PART_BYTES", 200)
    assert obk("export", recording, "--to", "parquet", "--topic", "speed") == 0
    table = pyarrow.parquet.read_table("arm/arm.speed.parquet")
    assert table["data"].to_pylist() == [float(number) for number in range(40)]


@pytest.mark.parametrize(
    ("words", "code", "reported"),
    [
        (("arm.mcap", "--to", "xlsx"), 2, "`--to xlsx`"),
        (("arm.mcap", "--to", "csv", "--topic", "jonts"), 1, "`jonts`"),
        (("arm.mcap", "--to", "csv", "-o", "arm.mcap"), 1, "arm.mcap"),
        (("none", "--to", "csv"), 1, "`none`"),
    ],
)
def test_a_mistake_is_reported_without_a_trace(
    recording: Path,
    words: tuple[str, ...],
    code: int,
    reported: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert obk("export", *words) == code
    error = capsys.readouterr().err
    assert reported in error
    assert "Traceback" not in error


def test_a_truncated_recording_is_exported_with_a_warning_that_names_its_end(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recording.read_bytes()
    recording.write_bytes(whole[: whole.rindex(b"/arm/speed")])  # within the summary
    assert obk("export", recording, "--to", "csv") == 0
    shown = capsys.readouterr()
    assert "arm/arm.joints.csv  40 messages" in shown.out
    assert "incomplete" in shown.err
    assert "t = 0.039 s" in shown.err


@pytest.mark.parametrize("kept", [60, 300])
def test_a_truncated_recording_without_messages_is_an_error(
    kept: int, recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording.write_bytes(recording.read_bytes()[:kept])
    assert obk("export", recording, "--to", "parquet") == 1
    shown = capsys.readouterr()
    assert (shown.out, "contains no messages" in shown.err) == ("", True)
    assert not Path("arm").exists()


def test_a_topic_without_messages_is_an_error_that_names_the_others(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert obk("export", recording, "--to", "csv", "--topic", "silent") == 1
    error = capsys.readouterr().err
    assert "no messages of `/arm/silent`" in error
    assert "`/arm/speed`" in error
    assert obk("export", recording, "--to", "csv", "--topic", "silent", "--topic", "speed") == 0
    assert "no messages of `/arm/silent`" in capsys.readouterr().err
