"""The status of a run, computed from its events, and the lines at the bottom of the terminal."""

import pytest
from rich.cells import cell_len

from obelisk_spec.runtime_protocol import Rate, Standing
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.events import (
    AnswersAgain,
    Failed,
    Hung,
    OutputEvent,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RateKept,
    RateMoved,
    Restarting,
    StackStateChanged,
    StateSeen,
    TransitionEnded,
)
from obk_cli.launch.process_groups import units_of
from obk_cli.launch.status import LiveReport, opening_status, status_lines, with_event
from obk_cli.plan.plan import Plan
from obk_cli.runs.protocol import Result, StackStatus
from obk_cli.terminal import plain

from ..plans import node  # noqa: TID252 - shared by folders of tests

CONTROL, ROBOT = "/obelisk_control_0", "/obelisk_robot_0"
EMPTY = Plan(name="dummy", nodes=())


PLAN = Plan(
    name="dummy",
    nodes=(
        node("joystick", "joystick", has_lifecycle=False),
        node("obelisk_control_0"),
        node("obelisk_robot_0", "robot"),
    ),
)
MANY = Plan(
    name="many",
    nodes=tuple(
        node(f"obelisk_{section}_{n}", section)
        for section in ("robot", "sensing", "control")
        for n in range(10)
    ),
)


def status_after(
    *events: OutputEvent, plan: Plan = PLAN, together: tuple[str, ...] = ()
) -> StackStatus:
    units = units_of(plan, devices=("onboard",), together=together)
    status = opening_status(plan, units)
    for event in events:
        status = with_event(status, event)
    return status


def ended(node: str, transition: str, result: Result = "reached") -> TransitionEnded:
    return TransitionEnded(node=node, transition=transition, result=result, seconds=0.1)


def shown(status: StackStatus, width: int = 80, height: int = 24) -> list[str]:
    """The lines below the rule."""
    rule, *lines = status_lines(status, width, height, colour=False)
    assert set(rule) == {"─"}
    return lines


def started(plan: Plan = PLAN) -> tuple[OutputEvent, ...]:
    return tuple(ProcessStarted(process=p.full_name, pid=n) for n, p in enumerate(plan.nodes))


def test_the_bring_up_shows_its_progress() -> None:
    starting = started()[:2]
    assert shown(status_after(*starting)) == [
        "dummy  starting  ━━━━────────────────  2 of 3 started  0:00:00  3 nodes",
        "robot_0 waiting   control_0 started   joystick running",
    ]
    ready = (*started(), Phase(name="ready", seconds=1.6), ended(ROBOT, "configure"))
    assert shown(status_after(*ready)) == [
        "dummy  ready  ━━━━━━━━━━──────────  1 of 2 configured  0:00:01  3 nodes",
        "robot_0 inactive   control_0 unconfigured   joystick running",
    ]
    on = (*ready, ended(CONTROL, "configure"), StackStateChanged(state="activating"))
    assert shown(status_after(*on, ended(ROBOT, "activate"))) == [
        "dummy  activating  ━━━━━━━━━━━━━━━━────  1 of 2 active  0:00:01  3 nodes",
        "robot_0 active   control_0 inactive   joystick running",
    ]


def test_a_steady_stack_shows_its_state_and_faults() -> None:
    events = (
        *started(),
        *(ended(node, t) for t in ("configure", "activate") for node in (ROBOT, CONTROL)),
        Phase(name="active", seconds=3600),
        Restarting(nodes=(CONTROL,), wait_s=0.5, attempt=1, attempts=3),
        ProcessStarted(process=CONTROL, pid=9),
        StackStateChanged(state="inactive"),
        Hung(node=ROBOT, seconds=2.0),
    )
    assert shown(status_after(*events)) == [
        "dummy  inactive  1:00:00  3 nodes  1 restart  1 hanging",
        "robot_0 hangs   control_0 restarting   joystick running",
    ]
    assert "control_0 inactive (restarted 1x)" in " ".join(
        shown(status_after(*events, ended(CONTROL, "configure")))
    )


def measured(hz: float, standing: Standing, name: str = "timer_ctrl") -> Rate:
    return Rate(
        name=name,
        expected_hz=1000.0,
        measured_hz=hz,
        ticks=1,
        overruns=0,
        late_p50_us=1.0,
        late_p99_us=2.0,
        late_max_us=3.0,
        standing=standing,
    )


def test_a_deviating_rate_is_shown_next_to_its_node_until_kept_or_inactive() -> None:
    up = [*started(PLAN), StateSeen(node=CONTROL, state="active"), Phase(name="active", seconds=1)]
    off = RateMoved(node=CONTROL, rate=measured(880, "off"))
    broken = RateBroken(node=CONTROL, rate=measured(512.34, "broken"), origin="")
    other = RateMoved(node=CONTROL, rate=measured(700, "off", "timer_log"))
    for events, reported in (
        ((off,), "control_0 active timer_ctrl 880/1000 Hz"),
        ((off, broken), "control_0 active timer_ctrl 512.3/1000 Hz"),
        ((broken, other), "active timer_ctrl 512.3/1000 Hz timer_log 700/1000 Hz"),
        ((off, RateKept(node=CONTROL, rate=measured(999, "kept"))), ""),
        ((off, RateMoved(node=CONTROL, rate=measured(999, "kept"))), ""),
        ((broken, StateSeen(node=CONTROL, state="inactive")), ""),
    ):
        text = "\n".join(shown(status_after(*up, *events), 160, 50))
        assert reported in text
        assert ("Hz" in text) == bool(reported)
    assert "2 rates off" in shown(status_after(*up, broken, other), 160, 50)[0]


@pytest.mark.parametrize(
    ("event", "state"),
    [
        (ended(ROBOT, "deactivate", "already there"), "inactive"),
        (ended(ROBOT, "activate", "rolled back"), "inactive"),
        (ended(ROBOT, "configure", "rolled back"), "unconfigured"),
        (ended(ROBOT, "deactivate", "refused"), "active"),
        (ended(ROBOT, "deactivate", "timed out"), "active"),
        (StateSeen(node=ROBOT, state="unconfigured"), "unconfigured"),
        (Failed(node=ROBOT, fault="x"), "errorprocessing"),
        (ProcessEnded(process=ROBOT, code=1), "finalized"),
        (ProcessEnded(process="/unused", code=1), "active"),
        (AnswersAgain(node=ROBOT), "active"),
    ],
)
def test_events_move_the_node_that_they_name(event: OutputEvent, state: str) -> None:
    before = status_after(*started(), ended(ROBOT, "activate"))
    after = with_event(before, event)
    assert [node.state for node in after.nodes] == [state, "unknown", ""]


def test_nodes_that_share_a_process_start_and_end_together() -> None:
    together = (ROBOT, CONTROL)
    status = status_after(
        ProcessStarted(process="/dummy/composed", pid=7), plan=PLAN, together=together
    )
    assert [node.pid for node in status.nodes] == [7, 7, None]
    status = with_event(status, ProcessEnded(process="/dummy/composed", code=-9))
    assert [node.state for node in status.nodes] == ["finalized", "finalized", ""]


def test_nodes_of_other_devices_are_shown_by_the_lead() -> None:
    units = units_of(PLAN, devices=("base",))
    assert len(opening_status(PLAN, units).nodes) == 3
    assert opening_status(PLAN, units, leads=False).nodes == ()


def test_rolling_back_is_an_episode() -> None:
    status = status_after(
        Phase(name="active", seconds=1),
        Phase(name="rolling back", seconds=2),
        StackStateChanged(state="x"),
    )
    assert shown(status)[0] == "dummy  x  0:00:01  3 nodes"


def test_nodes_that_do_not_fit_are_summed_up_and_faulty_ones_named() -> None:
    steady = Phase(name="active", seconds=1)
    names = [p.full_name for p in MANY.nodes]
    up = [ended(name, "activate") for name in names]
    sick = (Hung(node=names[13], seconds=2), ProcessEnded(process=names[29], code=1))
    status = status_after(*started(MANY), *up, steady, *sick, plan=MANY)
    assert shown(status) == [
        "many  active  0:00:01  30 nodes  1 hanging",
        "robot    10 active",
        "sensing  9 active  1 hangs: sensing_3",
        "control  9 active  1 ended: control_9",
    ]
    assert shown(status, height=13)[1:] == [
        "all  28 active  1 hangs: sensing_3  1 ended: control_9"
    ]
    assert len(shown(status, 160, 50)) > len(shown(status))
    assert any("sensing_3 hangs" in line for line in shown(status, 160, 50))


def test_no_size_is_too_small_and_no_name_too_long() -> None:
    long = Plan(name="长" * 30, nodes=(node("长" * 50), *MANY.nodes))
    for plan in (EMPTY, PLAN, long):
        for phase in ("starting", "ready", "active", "stopping"):
            status = status_after(Phase(name=phase, seconds=1), plan=plan)
            for width in (1, 2, 3, 10, 40, 80, 160):
                for height in (1, 3, 8, 9, 24, 50):
                    lines = status_lines(status, width, height, colour=True)
                    assert len(lines) <= max(1, height // 3)
                    assert all(cell_len(plain(line)) <= max(1, width - 1) for line in lines)


def test_a_live_report_describes_events_and_draws_the_elapsed_time() -> None:
    now = 100.0

    def clock() -> float:
        return now

    report = LiveReport(
        LaunchReport((ROBOT,), colour=False, quiet=False), status_after(), clock=clock, colour=False
    )
    assert list(report.event(Phase(name="active", seconds=0))) == ["[  0.00 s] active"]
    assert list(report.line(ROBOT, "hello")) == ["robot_0 | hello"]
    now = 165.0
    assert report.draw(80, 24)[1] == "dummy  active  0:01:05  3 nodes"
    drawn = report.draw(80, 24)
    now = 165.9
    assert report.draw(80, 24) is drawn
    list(report.event(Hung(node=ROBOT, seconds=2)))
    assert report.draw(80, 24)[1].endswith("1 hanging")
