"""`obk diff`: two recordings that differ in known ways."""

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obelisk_py.recordings import open_run
from obk_cli.cli.main import main
from obk_cli.record.compare import SignalDifference, compare_runs
from obk_cli.record.mcap_writer import BagWriter

MS = 1_000_000
DEFINITION = "# Position [rad].\nfloat64 q\nint32 sec\nfloat64[] w\n"


def plan(gain: float, node: str = "control_0") -> str:
    process = {"node": node, "origin": {"line": gain}, "parameters": {"kp": gain}, "device": "a"}
    return json.dumps({"name": "arm", "processes": [process]})


def written(
    path: Path,
    q: Callable[[float], float],
    *,
    count: int = 101,
    start_ns: int = 0,
    step_ns: int = 10 * MS,
    gain: float = 20.0,
    obk: str = "0.1.0",
    definition: str = DEFINITION,
    topic: str = "/arm/est",
    width: int = 1,
) -> Path:
    """A number over time, starting with the first message."""
    with BagWriter(path) as writer:
        writer.describe({"obelisk_versions": {"obk": obk}}, {"plan.json": plan(gain)}, 0)
        channel = writer.add_topic(topic, "demo_msgs/msg/Est", definition, {})
        for number in range(count):
            time_ns = start_ns + number * step_ns
            value = q((time_ns - start_ns) * 1e-9)
            data = struct.pack(f"<diI{width}d", value, number, width, *[0.5] * width)
            writer.add_message(channel, b"\0\1\0\0" + data, time_ns, time_ns, number)
    return path


def compared(first: Path, second: Path) -> Any:
    return compare_runs(open_run(first), open_run(second))


def test_a_run_equals_itself(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", np.sin)
    found = compared(path, path)
    assert found.is_same
    assert (found.versions, found.config, found.parameters) == ((), (), ())
    assert [(one.signal, one.largest) for one in found.signals] == [("q", 0.0), ("w[0]", 0.0)]


def test_a_signal_is_compared_at_the_same_time_since_activation(tmp_path: Path) -> None:
    first = written(tmp_path / "a.mcap", lambda t: 2.0 * t, start_ns=10**18)
    second = written(tmp_path / "b.mcap", lambda t: t, start_ns=5 * 10**17, step_ns=7 * MS)
    (q, _) = compared(first, second).signals
    # The second run ends after 0.7 s; between its messages it is interpolated.
    assert q == SignalDifference(
        topic="/arm/est",
        signal="q",
        unit="rad",
        rms=pytest.approx(np.sqrt(np.mean(np.arange(71) ** 2)) * 0.01),
        largest=pytest.approx(0.7),
        at_s=pytest.approx(0.7),
        count=71,
        missing=(0, 0),
        span=pytest.approx(1.4),
    )
    assert q.is_within(0.5)
    assert not q.is_within(0.2)


def burst(path: Path, *values: float) -> Path:
    """Several messages at one time."""
    numbers = iter(values)
    return written(path, lambda _: next(numbers), count=len(values), step_ns=0)


def test_messages_of_one_time_are_compared_in_their_order(tmp_path: Path) -> None:
    first = burst(tmp_path / "a.mcap", 1.0, 5.0, 3.0)
    assert compared(first, first).is_same
    (q, _) = compared(first, burst(tmp_path / "b.mcap", 1.0, 5.5, 3.0)).signals
    assert (q.largest, q.count) == (0.5, 3)


def half_nan(t: float) -> float:
    return 1.0 if t < 0.5 else math.nan


def test_a_number_that_is_missing_in_one_run_is_a_difference(tmp_path: Path) -> None:
    number = written(tmp_path / "a.mcap", lambda _: 1.0)
    nan = written(tmp_path / "b.mcap", lambda _: math.nan)
    half = written(tmp_path / "c.mcap", half_nan)
    for first, second, missing in (
        (number, nan, (0, 101)),
        (nan, number, (101, 0)),
        (half, number, (51, 0)),
        (nan, half, (50, 0)),
    ):
        found = compared(first, second)
        q = found.signals[0]
        assert (q.signal, q.missing, q.largest) == ("q", missing, 0.0)
        assert not found.is_same
        assert not q.is_within(0.05)
    for path in (nan, half):
        assert compared(path, path).is_same


def test_the_numbers_of_a_longer_array_are_missing_in_the_other_run(tmp_path: Path) -> None:
    long = written(tmp_path / "a.mcap", np.sin, width=2)
    for other, missing in (("b", 1), ("c", 0)):
        found = compared(long, written(tmp_path / f"{other}.mcap", np.sin, width=missing))
        assert not found.is_same
        absent = [one.signal for one in found.signals if one.missing == (0, 101)]
        assert absent == [f"w[{place}]" for place in range(missing, 2)]


def with_array(path: Path, kind: str, values: list[float], topic: str = "/cam") -> Path:
    """Three messages with the same array."""
    with BagWriter(path) as writer:
        channel = writer.add_topic(topic, "demo_msgs/msg/Array", f"{kind}[] data\n", {})
        items = np.array(values, {"uint8": "u1", "float32": "f4"}[kind]).tobytes()
        data = b"\0\1\0\0" + struct.pack("<I", len(values)) + items
        for number in range(3):
            writer.add_message(channel, data, number * MS, number * MS, number)
    return path


def test_a_long_array_is_one_signal(tmp_path: Path) -> None:
    first = with_array(tmp_path / "a.mcap", "float32", [0.0] * 100)
    second = with_array(tmp_path / "b.mcap", "float32", [*[0.0] * 99, 2.0])
    (data,) = compared(first, second).signals
    assert (data.signal, data.count, data.largest) == ("data", 300, 2.0)
    assert data.rms == pytest.approx(0.2)
    short = with_array(tmp_path / "c.mcap", "float32", [0.0] * 32)
    assert len(compared(short, short).signals) == 32


def test_long_arrays_of_bytes_are_equal_or_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = with_array(tmp_path / "a.mcap", "uint8", [7] * 5000)
    second = with_array(tmp_path / "b.mcap", "uint8", [*[7] * 4999, 8])
    for size in (1, 1 << 24):
        monkeypatch.setattr("obelisk_recordings.chunks.PART_BYTES", size)
        found = compared(first, second)
        assert found.signals == found.without_numbers == ()
        (data,) = found.byte_arrays
        assert (data.topic, data.field, data.is_same) == ("/cam", "data", False)
        assert not found.is_same
        same = compared(first, first)
        assert same.is_same
        assert [one.is_same for one in same.byte_arrays] == [True]


def test_the_log_is_not_compared(tmp_path: Path) -> None:
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for line, path in enumerate(paths):
        with BagWriter(path) as writer:
            channel = writer.add_topic("/rosout", "demo_msgs/Log", "uint32 line\nstring msg\n", {})
            writer.add_message(channel, b"\0\1\0\0" + struct.pack("<II2s", line, 2, b"a"), 1, 1, 1)
    found = compared(*paths)
    assert (found.topics, found.signals) == ((), ())
    assert found.is_same


def test_topics_without_numbers_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        channel = writer.add_topic("/mode", "std_msgs/msg/String", "string data\n", {})
        for number in range(3):
            data = b"\0\1\0\0" + struct.pack("<I5s", 5, b"walk\0")
            writer.add_message(channel, data, number, number, number)
    found = compared(path, path)
    assert (found.signals, found.without_numbers) == ((), ("/mode",))


def test_parts_of_any_size_give_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = written(tmp_path / "a.mcap", np.sin)
    second = written(tmp_path / "b.mcap", np.cos, step_ns=3 * MS, count=300)
    (whole, _) = compared(first, second).signals
    monkeypatch.setattr("obk_cli.record.mcap_writer.CHUNK_BYTES", 256)
    first = written(tmp_path / "c.mcap", np.sin)
    second = written(tmp_path / "d.mcap", np.cos, step_ns=3 * MS, count=300)
    for size in (1, 300, 2000):
        monkeypatch.setattr("obelisk_recordings.chunks.PART_BYTES", size)
        (parts, _) = compared(first, second).signals
        assert (parts.count, parts.largest, parts.at_s) == (whole.count, whole.largest, whole.at_s)
        assert parts.rms == pytest.approx(whole.rms)


def test_the_configs_of_the_runs_are_compared(tmp_path: Path) -> None:
    first = written(tmp_path / "a.mcap", np.sin)
    second = written(
        tmp_path / "b.mcap", np.sin, gain=25.0, obk="0.2.0", definition=DEFINITION + "# new\n"
    )
    found = compared(first, second)
    assert [(one.what, one.first, one.second) for one in found.versions] == [
        ("obk", "0.1.0", "0.2.0")
    ]
    assert [(one.what, one.first, one.second) for one in found.parameters] == [
        ("control_0 kp", 20.0, 25.0)
    ]
    assert found.config == ()
    assert not found.topics[0].same_definition
    assert not found.is_same


def test_a_topic_of_one_run_only_is_reported(tmp_path: Path) -> None:
    first = written(tmp_path / "a.mcap", np.sin)
    second = written(tmp_path / "b.mcap", np.sin, topic="/arm/other")
    found = compared(first, second)
    assert [(one.topic, one.count) for one in found.topics] == [
        ("/arm/est", (101, 0)),
        ("/arm/other", (0, 101)),
    ]
    assert found.signals == ()
    assert not found.is_same


def test_rates_lateness_and_rejected_commands(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    first = written(tmp_path / "a" / "recording.mcap", np.sin)
    first.with_name("launch.log").write_text(
        "[robot_0] control rejected: NaN in `u_mujoco[0]` (3 times); 3 in total\n"
        "[robot_0] control rejected: NaN in `u_mujoco[0]` (4 times); 7 in total\n"
    )
    second = written(tmp_path / "b.mcap", np.sin, step_ns=5 * MS)
    found = compared(first, second)
    assert found.topics[0].rate_hz == pytest.approx((100.0, 200.0))
    assert found.topics[0].jitter_p99_ms == pytest.approx((0.0, 0.0), abs=1e-6)
    assert found.rejected_commands == (7, None)


def obk(*words: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_recordings_without_messages_are_not_equal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    empty = written(tmp_path / "empty.mcap", np.sin, count=0)
    full = written(tmp_path / "full.mcap", np.sin)
    for first, second in ((empty, empty), (empty, full), (full, empty)):
        assert obk("diff", first, second) == 1
        shown = capsys.readouterr()
        assert "no number differs" not in shown.out
        assert "`empty`" in shown.err


def test_the_command_prints_a_table_or_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    first = written(tmp_path / "before.mcap", lambda _: 1.0)
    second = written(tmp_path / "after.mcap", lambda _: 1.5, gain=25.0)
    assert obk("diff", first, second) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["before", "after", "rms", "max", "at", "[s]"]
    assert ["parameters:", "control_0", "kp", "20.0", "25.0"] in rows
    assert ["/arm/est.q", "[rad]", "0.5", "0.5", "0.000"] in rows
    assert obk("diff", first, second, "--format", "json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["signals"][0]["rms"] == pytest.approx(0.5)
    assert found["parameters"][0] == {"what": "control_0 kp", "first": 20.0, "second": 25.0}
    assert obk("diff", first, "none") == 1
    assert "`none`" in capsys.readouterr().err
