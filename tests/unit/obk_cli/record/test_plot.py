"""Fields of recorded runs by name, and the lines plotted from them."""

import json
import re
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2.writer import Writer

from obelisk_recordings.bag import RecordingError
from obelisk_recordings.run import RecordedRun, open_run, topic_named
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.record.mcap_writer import BagWriter
from obk_cli.record.plot import (
    MOST_POINTS,
    FieldName,
    PlotPart,
    _thinned,
    draw,
    parse_field,
    plot_parts,
    write_page,
)

from ....browser import opened  # noqa: TID252 - shared by folders of tests

BAR = "=" * 80
DEFINITION = f"""\
string frame
Vector gyro # [rad/s]
bool ok
# Positions [rad].
float64[] position
string[] joint_names
Vector[] sides
{BAR}
MSG: demo_msgs/Vector
float64 x
float64 y
"""


def reading(**values: Any) -> dict[str, Any]:
    message = {
        "frame": "world",
        "gyro": {"x": 1.0, "y": 2.0},
        "ok": True,
        "position": [3.0, 4.0],
        "joint_names": [],
        "sides": [{"x": 5.0, "y": 6.0}],
    }
    return {**message, **values}


def recorded(path: Path, *messages: dict[str, Any]) -> RecordedRun:
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("demo_msgs/msg/Reading", DEFINITION)
        for second, message in enumerate(messages or (reading(),)):
            writer.write_message("/arm/t", schema, message, 10**9 * second)
        writer.finish()
    return open_run(path)


def parts(runs: Iterable[RecordedRun], *texts: str, overlay: bool = False) -> tuple[PlotPart, ...]:
    return plot_parts([*runs], [parse_field(text) for text in texts], overlay=overlay)


def lines(folder: Path, text: str, *messages: dict[str, Any]) -> dict[str, list[float]]:
    (part,) = parts([recorded(folder / "a.mcap", *messages)], text)
    return {line.label: line.values.tolist() for line in part.lines}


def test_a_field_is_a_topic_and_the_way_into_its_message() -> None:
    assert parse_field("/arm/imu.sides[2].x") == FieldName(
        topic="/arm/imu", path="sides[2].x", text="/arm/imu.sides[2].x"
    )


@pytest.mark.parametrize("text", ["imu", "imu.", ".x", "imu.x..y", "imu.x[]", "imu.x y", ""])
def test_invalid_fields_are_reported(text: str) -> None:
    with pytest.raises(MisuseError, match="does not name a field"):
        parse_field(text)


def test_a_number_is_one_line_an_array_or_a_message_one_for_each_number(tmp_path: Path) -> None:
    assert lines(tmp_path, "t.gyro.x") == {"": [1.0]}
    assert lines(tmp_path, "t.ok") == {"": [1.0]}
    assert lines(tmp_path, "t.position") == {"[0]": [3.0], "[1]": [4.0]}
    assert lines(tmp_path, "t.position[1]") == {"": [4.0]}
    assert lines(tmp_path, "t.gyro") == {"x": [1.0], "y": [2.0]}
    assert lines(tmp_path, "t.sides") == {"[0].x": [5.0], "[0].y": [6.0]}
    named = reading(joint_names=["hip", "knee"])
    assert lines(tmp_path, "t.position", named) == {"hip": [3.0], "knee": [4.0]}


def test_an_array_of_varying_size_has_the_existing_numbers(tmp_path: Path) -> None:
    shorter = reading(position=[7.0])
    both = (shorter, reading())
    assert lines(tmp_path, "t.position", *both) == {"[0]": [7.0, 3.0], "[1]": [4.0]}
    assert lines(tmp_path, "t.position[1]", *both) == {"": [4.0]}


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("t.giro", "did you mean `gyro`"),
        ("t.gyro.z", "did you mean `gyro.y`, `gyro.x`"),
        ("t.frame", "contains no numbers"),
        ("t.ok[0]", "is not an array"),
        ("t.gyro.x.y", "has no field `gyro.x.y`"),
        ("t.position[2]", "has only 2 items"),
        ("u.ok", "has no topic `u`"),
    ],
)
def test_a_missing_field_is_reported_with_the_existing_ones(
    tmp_path: Path, text: str, reported: str
) -> None:
    with pytest.raises(RecordingError, match=reported.replace("[", "\\[")):
        lines(tmp_path, text)


def test_more_lines_than_can_be_distinguished_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(CommandFailedError) as error:
        lines(tmp_path, "t.position", reading(position=[0.0] * 100))
    assert error.value.help == "select one, such as t.position[32]"


def test_a_topic_may_be_named_by_its_end() -> None:
    topics = ["/arm/imu", "/leg/imu", "/arm/est"]
    assert topic_named("/arm/imu", topics) == "/arm/imu"
    assert topic_named("est", topics) == "/arm/est"
    with pytest.raises(RecordingError, match="matches several topics"):
        topic_named("imu", topics)
    with pytest.raises(RecordingError, match="has no topic `st`"):
        topic_named("st", topics)


@pytest.mark.parametrize("text", [f"/a.b[{'9' * 5000}]", "/a.b[\u0661]", "/a.b[-1]"])
def test_an_index_outside_of_an_array_names_no_field(text: str) -> None:
    with pytest.raises(MisuseError, match="does not name a field"):
        parse_field(text)


def two_runs(folder: Path) -> list[RecordedRun]:
    one = recorded(folder / "one.mcap", *(reading(position=[n, 2.0 * n]) for n in range(5)))
    two = recorded(folder / "two.mcap", *(reading(position=[n + 0.5]) for n in range(3)))
    return [one, two]


def test_runs_are_drawn_over_each_other_with_one_color_for_each_number(tmp_path: Path) -> None:
    (part,) = parts(two_runs(tmp_path), "t.position")
    shown = [(line.label, line.run, line.colour) for line in part.lines]
    assert shown == [("one [0]", 0, 0), ("one [1]", 0, 1), ("two [0]", 1, 0)]
    assert part.label == "t.position [rad]"
    assert part.lines[2].times_s.tolist() == [0.0, 1.0, 2.0]
    assert part.lines[2].values.tolist() == [0.5, 1.5, 2.5]


def test_fields_have_a_part_each_or_one_for_all(tmp_path: Path) -> None:
    runs = two_runs(tmp_path)[:1]
    assert [part.label for part in parts(runs, "t.position[0]", "t.gyro.x")] == [
        "t.position[0] [rad]",
        "t.gyro.x [rad/s]",
    ]
    (part,) = parts(runs, "t.position[0]", "t.gyro.x", overlay=True)
    assert (part.title, part.unit) == ("t.position[0], t.gyro.x", "")
    assert [(line.label, line.colour) for line in part.lines] == [
        ("t.position[0]", 0),
        ("t.gyro.x", 1),
    ]


def test_one_item_has_the_joints_name_in_its_legend_like_the_whole_array(tmp_path: Path) -> None:
    message = reading(joint_names=["hip", "knee"])
    assert lines(tmp_path, "t.position[1]", message) == {"knee": [4.0]}
    assert lines(tmp_path, "t.position[knee]", message) == {"": [4.0]}
    assert lines(tmp_path, "t.position", message) == {"hip": [3.0], "knee": [4.0]}
    (part,) = parts([open_run(tmp_path / "a.mcap")], "t.position[1]")
    draw([part], "one", tmp_path / "one.svg")
    assert ">knee</text>" in (tmp_path / "one.svg").read_text()
    (part,) = parts([open_run(tmp_path / "a.mcap")], "t.position[1]", "t.gyro.x", overlay=True)
    assert [line.label for line in part.lines] == ["knee t.position[1]", "t.gyro.x"]


def controls_of(folder: Path, *actuators: tuple[str, str]) -> PlotPart:
    """The plot of two controls, recorded with the plan of a robot with these actuators."""
    robot = {
        "subscribes": [{"topic": "/arm/ctrl"}],
        "actuators": [{"name": name, "unit": unit} for name, unit in actuators],
    }
    path = folder / "controls.mcap"
    with BagWriter(path) as bag:
        bag.describe({}, {"plan.json": json.dumps({"processes": [robot]})}, 0)
        channel = bag.add_topic("/arm/ctrl", "demo_msgs/msg/Control", "float64[] u_mujoco", {})
        data = struct.pack("<BBHIIdd", 0, 1, 0, 2, 0, 0.5, 1.5)
        bag.add_message(channel, data, 0, 0, 0)
    (part,) = parts([open_run(path)], "ctrl.u_mujoco")
    return part


def test_controls_have_the_names_and_the_unit_of_the_models_actuators(tmp_path: Path) -> None:
    part = controls_of(tmp_path, ("hip", "N m"), ("knee", "N m"))
    assert part.label == "ctrl.u_mujoco [N m]"
    assert [(line.label, line.values.tolist()) for line in part.lines] == [
        ("hip", [0.5]),
        ("knee", [1.5]),
    ]


def test_controls_of_other_lengths_or_units_claim_none(tmp_path: Path) -> None:
    assert controls_of(tmp_path, ("hip", "N m"), ("rail", "N")).label == "ctrl.u_mujoco"
    (tmp_path / "controls.mcap").unlink()
    part = controls_of(tmp_path, ("hip", "N m"))
    assert (part.unit, [line.label for line in part.lines]) == ("", ["[0]", "[1]"])


def test_only_the_requested_times_are_drawn(tmp_path: Path) -> None:
    drawn = parts(two_runs(tmp_path), "t.position")
    draw(drawn, "all", tmp_path / "all.svg")
    draw(drawn, "all", tmp_path / "part.svg", xlim=(0.0, 1.0))
    assert (tmp_path / "all.svg").read_text() != (tmp_path / "part.svg").read_text()


SHOWN = """() => obkPlots.map((plot) => ({
    labels: plot.series.map((one) => one.label),
    axis: plot.axes[1].label,
    min: plot.scales.x.min,
    max: plot.scales.x.max,
    data: plot.data.map((column) => Array.from(column)),
}))"""


@pytest.mark.browser
def test_the_page_draws_the_numbers_without_a_network(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    drawn = parts(two_runs(tmp_path), "t.position[0]", "t.gyro")
    write_page(drawn, "</script><b>one & two", page, xlim=(0.0, 2.5))
    assert "</script><b>one" not in page.read_text()
    with opened(page.as_uri(), width=900, height=800) as browser:
        problems: list[str] = []
        requests: list[str] = []
        browser.on("pageerror", lambda error: problems.append(str(error)))
        browser.on("console", lambda line: problems.append(line.text))
        browser.on("request", lambda request: requests.append(request.url))
        browser.reload()
        browser.wait_for_function(
            "window.obkPlots !== undefined && obkPlots[0].scales.x.max === 2.5"
        )
        first, second = browser.evaluate(SHOWN)
        assert browser.locator("h1").inner_text() == "</script><b>one & two"
        assert (first["axis"], first["labels"]) == (
            "t.position[0] [rad]",
            ["t [s]", "one", "two"],
        )
        assert first["data"] == [
            [0, 1, 2, 3, 4],
            [0, 1, 2, 3, 4],
            [0.5, 1.5, 2.5, None, None],
        ]
        # Legends show the line styles of the runs.
        markers = browser.locator(".u-marker").evaluate_all(
            "all => all.map((one) => decodeURIComponent(one.style.backgroundImage))"
        )
        dashes = [re.findall(r'dasharray=\\?"([\d,]*)', one) for one in markers]
        assert dashes == [[], [""], ["8,4"], [], [""], [""], ["8,4"], ["8,4"]]
        assert second["labels"] == ["t [s]", "one x", "one y", "two x", "two y"]
        assert (second["min"], second["max"]) == (0, 2.5)
        # Zooming one plot zooms all.
        box = browser.locator(".u-over").first.bounding_box()
        assert box is not None
        y = box["y"] + 50
        browser.mouse.move(box["x"] + 0.2 * box["width"], y)
        browser.mouse.down()
        browser.mouse.move(box["x"] + 0.6 * box["width"], y, steps=5)
        browser.mouse.up()
        browser.wait_for_function("obkPlots[1].scales.x.min > 0.3")
        one, two = browser.evaluate(SHOWN)
        assert (one["min"], one["max"]) == (two["min"], two["max"])
        assert one["min"] == pytest.approx(0.5, abs=0.05)
        assert one["max"] == pytest.approx(1.5, abs=0.05)
        assert not problems
        assert {url.partition(":")[0] for url in requests} <= {"file", "data"}


def test_a_long_line_keeps_its_extremes_in_the_page() -> None:
    times = np.arange(1_000_003) * 1e-3
    values = np.sin(times)
    values[[123_456, 1_000_002]] = (7.0, -5.0)
    few_times, few_values = _thinned(times, values, MOST_POINTS)
    assert len(few_times) <= MOST_POINTS
    assert (np.diff(few_times) > 0.0).all()
    assert (few_values.max(), few_values.min()) == (7.0, -5.0)
