"""Fields over a whole run, from its recording."""

import base64
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from obelisk_recordings.find import RECORDING
from obk_cli.errors import CommandFailedError
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.web.history import MOST_POINTS, recorded_fields
from obk_cli.web.plots import FieldRequest

from ..monitor.stacks import HEALTHY  # noqa: TID252 - shared by folders of tests

BEGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 1_000_000


def recorded(folder: Path, count: int) -> Path:
    """A run with numbers `x` from 0 on, and `text`, each received 1 ms after the previous one."""
    (folder / HEALTHY.run).mkdir(parents=True)
    with BagWriter(folder / HEALTHY.run / RECORDING) as writer:
        channel = writer.add_topic("/t", "pkg/msg/Pair", "float64[2] x\n", {})
        for number in range(count):
            data = b"\0\1\0\0" + struct.pack("<dd", number, -number)
            at_ns = BEGIN_NS + number * STEP_NS
            writer.add_message(channel, data, at_ns, at_ns, number)
    return folder


def read(folder: Path, *fields: str) -> list[dict[str, Any]]:
    requests = [FieldRequest(topic="/t", field=field) for field in fields]
    return recorded_fields(HEALTHY, folder, requests)


def numbers(text: str) -> list[float]:
    return np.frombuffer(base64.b64decode(text), "<f8").tolist()


def test_lines_have_the_labels_of_the_live_plots_and_times_of_receipt(tmp_path: Path) -> None:
    (whole, one) = read(recorded(tmp_path, 3), "x", "x[1]")
    assert (whole["curve"], whole["fault"]) == ("/t x", "")
    assert [line["label"] for line in whole["lines"]] == ["x[0]", "x[1]"]
    assert [line["label"] for line in one["lines"]] == ["x[1]"]
    assert numbers(whole["lines"][1]["values"]) == [0.0, -1.0, -2.0]
    assert numbers(whole["lines"][0]["times"]) == pytest.approx([1.7e9, 1.7e9 + 1e-3, 1.7e9 + 2e-3])


def test_a_long_run_keeps_its_extremes(tmp_path: Path) -> None:
    count = 2 * MOST_POINTS
    (one,) = read(recorded(tmp_path, count), "x[0]")
    values = numbers(one["lines"][0]["values"])
    assert len(values) <= MOST_POINTS
    assert (values[0], values[-1]) == (0.0, count - 1)


def test_a_recording_in_progress_is_read_without_counting_its_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recorded(tmp_path, 1000)
    path = folder / HEALTHY.run / RECORDING
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b"float64[2] x")])  # within the summary
    monkeypatch.setattr("obelisk_recordings.summary.records_of", None)
    (one,) = read(folder, "x[0]")
    assert len(numbers(one["lines"][0]["values"])) == 1000


def test_a_missing_field_does_not_remove_the_others(tmp_path: Path) -> None:
    wrong, right = read(recorded(tmp_path, 2), "y", "x")
    assert "no field `y`" in wrong["fault"]
    assert right["lines"]


def test_a_topic_without_messages_is_reported(tmp_path: Path) -> None:
    (one,) = recorded_fields(
        HEALTHY, recorded(tmp_path, 1), [FieldRequest(topic="/other", field="x")]
    )
    assert "no message" in one["fault"]


def test_that_a_run_was_not_recorded_is_reported(tmp_path: Path) -> None:
    for view in (HEALTHY, replace(HEALTHY, run="")):
        with pytest.raises(CommandFailedError, match="has no recording on this host"):
            recorded_fields(view, tmp_path, [])
