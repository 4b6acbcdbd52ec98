"""Lines about rates on the screen."""

from pathlib import Path

import pytest

from obelisk_spec.runtime_protocol import Rate
from obk_cli.launch.console import Output
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import (
    Ended,
    OutputEvent,
    Phase,
    RateBroken,
    RateKept,
    RateMoved,
)
from obk_cli.launch.rates import INTERVAL_S

CONTROL, ROBOT = "/control", "/robot"


def rate(measured_hz: float, name: str = "timer_ctrl") -> Rate:
    return Rate(
        name=name,
        expected_hz=1000.0,
        measured_hz=measured_hz,
        ticks=1,
        overruns=0,
        late_p50_us=0.0,
        late_p99_us=0.0,
        late_max_us=0.0,
    )


def broken(measured_hz: float, node: str = CONTROL, name: str = "timer_ctrl") -> RateBroken:
    return RateBroken(node=node, rate=rate(measured_hz, name), origin="")


def kept(node: str = CONTROL, name: str = "timer_ctrl") -> RateKept:
    return RateKept(node=node, rate=rate(990.0, name))


class Launch:
    """A report at times that a test chooses."""

    def __init__(self) -> None:
        self.now = 0.0
        self.report = LaunchReport((), colour=False, quiet=False, clock=lambda: self.now)

    def screen(self, time_s: float, *events: OutputEvent) -> list[str]:
        """What the screen shows at a time, and of the events at that time."""
        self.now = time_s
        shown = list(self.report.due())
        for event in events:
            shown += self.report.on_screen(event, tuple(self.report.event(event)))
        return shown


@pytest.fixture
def launch() -> Launch:
    return Launch()


def test_the_first_break_of_each_node_is_shown_at_once(launch: Launch) -> None:
    assert launch.screen(0.0, broken(200.0), broken(300.0, ROBOT, "steps")) == [
        "  control: RATE: timer_ctrl runs at 200 of 1000 Hz",
        "  robot: RATE: steps runs at 300 of 1000 Hz",
    ]


def test_breaks_within_ten_seconds_are_one_line_with_count_and_lowest_rate(
    launch: Launch,
) -> None:
    launch.screen(0.0, broken(200.0))
    assert launch.screen(3.0, kept()) == []
    assert launch.screen(5.0, broken(700.0)) == []
    assert launch.screen(6.0, RateMoved(node=CONTROL, rate=rate(150.0))) == []
    assert launch.screen(8.0, kept(), broken(400.0)) == []
    assert launch.screen(10.0) == [
        "  control: RATE: timer_ctrl missed its rate 3 times in 10 s, "
        "lowest 150 of 1000 Hz, now 400 Hz"
    ]


def test_a_single_recovery_is_shown_as_such_at_the_end_of_the_interval(launch: Launch) -> None:
    launch.screen(0.0, broken(200.0), kept())
    assert launch.screen(INTERVAL_S) == ["  control: timer_ctrl runs at 990 of 1000 Hz again"]


def test_lines_of_a_node_that_keeps_breaking_are_ten_seconds_apart(launch: Launch) -> None:
    lines = [
        (t, line)
        for t in range(40)
        for line in launch.screen(float(t), broken(200.0) if t % 4 == 0 else kept())
    ]
    assert [t for t, _ in lines] == [0, 10, 20, 30]


def test_a_new_break_that_lasts_is_shown_with_its_place(launch: Launch) -> None:
    launch.screen(0.0, broken(200.0), kept())
    launch.screen(INTERVAL_S)
    event = RateBroken(node=CONTROL, rate=rate(300.0), origin="a.yaml:3:4")
    assert launch.screen(12.0, event) == []
    assert launch.screen(2 * INTERVAL_S) == [
        "  control: RATE: timer_ctrl runs at 300 of 1000 Hz; set at a.yaml:3:4"
    ]


def test_after_a_quiet_interval_the_next_event_is_shown_at_once(launch: Launch) -> None:
    launch.screen(0.0, broken(200.0))
    assert launch.screen(INTERVAL_S) == []
    assert launch.screen(15.0, kept()) == ["  control: timer_ctrl runs at 990 of 1000 Hz again"]
    assert launch.screen(16.0, broken(200.0)) == []
    assert launch.screen(25.0) == ["  control: RATE: timer_ctrl runs at 200 of 1000 Hz"]


def test_all_rates_of_a_node_share_a_line(launch: Launch) -> None:
    launch.screen(0.0, broken(200.0), broken(500.0, name="timer_b"), kept())
    assert launch.screen(INTERVAL_S) == [
        "  control: RATE: timer_b runs at 500 of 1000 Hz; timer_ctrl runs at 990 of 1000 Hz again"
    ]


@pytest.mark.parametrize(
    "end", [Phase(name="stopping", seconds=5.0), Ended(exit_code=1, cause="x")]
)
def test_what_is_left_is_shown_before_the_end(launch: Launch, end: OutputEvent) -> None:
    launch.screen(0.0, broken(200.0), kept(), broken(100.0))
    first, *_ = launch.screen(5.0, end)
    assert first == (
        "  control: RATE: timer_ctrl missed its rate 2 times in 5 s, "
        "lowest 100 of 1000 Hz, now 100 Hz"
    )


class Shown:
    """A screen."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def put(self, line: str, *, may_drop: bool = False) -> None:
        self.lines.append(line)


def test_nothing_follows_the_end_on_the_screen(tmp_path: Path, launch: Launch) -> None:
    shown = Shown()
    output = Output(tmp_path, shown, launch.report, ())  # type: ignore[arg-type]
    output.note("before")
    output.event(Ended(exit_code=0, cause=""))
    output.note("after")
    output.journal.close()
    assert shown.lines[0] == "before"
    assert "after" not in shown.lines
    assert "after" in (tmp_path / "launch.log").read_text()


def test_a_full_disk_is_reported_in_words(tmp_path: Path, launch: Launch) -> None:
    (tmp_path / "launch.log").symlink_to("/dev/full")
    shown = Shown()
    output = Output(tmp_path, shown, launch.report, ())  # type: ignore[arg-type]
    output.note("a line")
    warnings = [line for line in shown.lines if line.startswith("warning: ")]
    assert [line.rpartition(": ")[2] for line in warnings] == ["no space left on device"]


def test_the_log_has_a_line_for_each_event(tmp_path: Path, launch: Launch) -> None:
    shown = Shown()
    output = Output(tmp_path, shown, launch.report, ())  # type: ignore[arg-type]
    for event in (broken(200.0), kept(), broken(100.0), kept()):
        output.event(event)
    output.journal.close()
    assert len((tmp_path / "launch.log").read_text().splitlines()) == 4
    assert len(shown.lines) == 1
