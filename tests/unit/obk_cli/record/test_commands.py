"""The `obk bag`, `obk plot` and `obk record` commands, without ROS."""

import json
from pathlib import Path

import pytest

from obelisk_recordings.bag import DROPS
from obk_cli.cli.main import main
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.plot import PlotPart

SECOND = 1_000_000_000


@pytest.fixture
def bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    path = tmp_path / "speed.mcap"
    with BagWriter(path) as writer:
        writer.describe({"obelisk": {"run": "arm_1"}}, {"plan.json": "{}"}, SECOND)
        channel = writer.add_topic("/speed", "std_msgs/msg/Bool", "bool data\n", {})
        for number in range(1, 6):
            received_ns = number * SECOND
            sent_ns = received_ns - SECOND // 4
            writer.add_message(channel, b"\0\1\0\0\1", received_ns, sent_ns, number)
        writer.describe({DROPS: {"/speed": "2"}}, {}, SECOND)
    return path


def obk(*words: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_bag_info_shows_topics_rates_losses_and_origin(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert obk("bag", "info", bag) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{bag}: MCAP, profile ros2, ")
    assert lines[1].startswith("5 messages in 4.000 s from ")
    assert lines[2].split() == ["/speed", "std_msgs/msg/Bool", "5", "1.2", "Hz", "2", "LOST"]
    assert lines[3:] == ["obelisk:", "  run: arm_1", "attachments:", "  plan.json  2 bytes"]


def test_bag_info_as_json(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert obk("bag", "info", bag, "--format", "json") == 0
    reported = json.loads(capsys.readouterr().out)
    assert (reported["count"], reported["duration_s"], reported["is_complete"]) == (5, 4.0, True)
    assert reported["topics"][0]["lost"] == 2


def test_plot_names_the_picture_that_it_makes(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert obk("plot", bag, "speed.data") == 0
    assert capsys.readouterr().out == "speed_speed_data.png\n"
    assert Path("speed_speed_data.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("option", "first_s"), [((), -0.25), (("--received",), 0.0)])
def test_plot_is_over_the_time_of_publication_or_of_receipt(
    bag: Path, monkeypatch: pytest.MonkeyPatch, option: tuple[str, ...], first_s: float
) -> None:
    drawn: list[PlotPart] = []
    monkeypatch.setattr("obk_cli.record.plot.draw", lambda parts, *_: drawn.extend(parts))
    assert obk("plot", bag, "speed.data", *option) == 0
    (line,) = drawn[0].lines
    assert line.times_s == pytest.approx([first_s + number for number in range(5)])


def test_a_plot_may_begin_at_a_time_and_end_with_the_run(bag: Path) -> None:
    assert obk("plot", bag, "speed.data", "--xlim", "0", "inf") == 0
    assert Path("speed_speed_data.png").is_file()


def test_plot_takes_files_then_fields_and_writes_a_page(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert obk("plot", bag, "speed.mcap", "speed.data", "--html", "--xlim", "-1", "2") == 0
    assert capsys.readouterr().out == "speed_speed_data.html\n"
    assert Path("speed_speed_data.html").read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("words", "code", "reported"),
    [
        (("bag", "info", "none.mcap"), 1, "`none.mcap`"),
        (("plot", "speed.mcap", "speed"), 2, "`speed`"),
        (("plot", "speed.mcap", "sped.data"), 1, "`sped`"),
        (("plot", "speed.mcap", "speed.dat"), 1, "`data`"),
        (("plot", "speed.mcap", "speed.data", "-o", "a.gif"), 2, ".png, .svg or .html"),
        (("plot", "speed.mcap", "speed.data", "-o", "a.png", "--html"), 2, "ends in .html"),
        (("plot", "speed.mcap", "speed.data", "--xlim", "2", "1"), 2, "`--xlim 2 1`"),
        (("plot", "speed.mcap", "speed.data", "--xlim", "8", "9"), 2, "`--xlim 8 9`"),
        (("plot", "speed.mcap", "speed.data", "--xlim", "0", "1e300"), 2, "times up to 1e+09 s"),
        (("plot", "speed.mcap", "speed"), 2, "`speed` does not name a field"),
        (("record", "--duration", "0"), 2, "`--duration 0`"),
    ],
)
def test_a_mistake_is_reported_without_a_trace(
    bag: Path,
    words: tuple[str, ...],
    code: int,
    reported: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert obk(*words) == code
    error = capsys.readouterr().err
    assert reported in error
    assert "Traceback" not in error


def test_a_field_without_a_number_in_any_message_is_reported(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = bag.with_name("empty.mcap")
    with BagWriter(empty) as writer:
        channel = writer.add_topic("/gaps", "std_msgs/msg/Gaps", "float64[] data\n", {})
        writer.add_message(channel, b"\0\1\0\0" + bytes(4), SECOND, SECOND, 1)
    assert obk("plot", empty, "gaps.data") == 1
    assert capsys.readouterr().err.startswith("error: `gaps.data`: ")
    assert not list(bag.parent.glob("*.png"))
