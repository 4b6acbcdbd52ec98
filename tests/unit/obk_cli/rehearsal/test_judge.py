"""What is right and what is not, case by case, and how it is shown."""

import json
import re

import pytest

from obk_cli.launch.events import (
    AnswersAgain,
    Ended,
    GoesOnWithout,
    Hung,
    ProcessEnded,
    Restarted,
    Restarting,
    Told,
)
from obk_cli.launch.journal import event_record
from obk_cli.plan.plan import OnCrash
from obk_cli.rehearsal.judge import has_concluded, judge
from obk_cli.rehearsal.scene import Moment, Scene, parse_moment
from obk_cli.report.rehearsal import HEAD, rehearsal_json, rehearsal_table, rehearsal_text

from .stage import CONTROLLER, ESTIMATOR, ROBOT, case, moments, scene, status

DIED = (0.01, ProcessEnded(process=ROBOT, code=-9))
HUNG = (1.7, Hung(node=ROBOT, seconds=1.7))
RESTARTING = (0.1, Restarting(nodes=(ROBOT,), wait_s=0.1, attempt=1, attempts=5))
BACK = (1.5, Restarted(nodes=(ROBOT,)))
WITHOUT = (0.1, GoesOnWithout(nodes=(ROBOT,)))
ANEW = {ROBOT: 9}
LOST: dict[str, int | None] = {ROBOT: None}


def ended(
    cause: str = f"{ROBOT}: the process was ended by SIGKILL", origin: str = "c.yaml:1:1"
) -> tuple[float, Ended]:
    return 0.5, Ended(exit_code=1, cause=cause, origin=origin)


@pytest.mark.parametrize(
    ("on_crash", "begin", "end", "of_another"),
    [
        ("stop", DIED, ended(), BACK),
        ("restart", RESTARTING, BACK, (1.5, Restarted(nodes=(CONTROLLER,)))),
        ("ignore", DIED, WITHOUT, (0.1, GoesOnWithout(nodes=(CONTROLLER,)))),
    ],
)
def test_a_reaction_is_over_when_the_launcher_has_told_its_end(
    on_crash: OnCrash,
    begin: tuple[float, Told],
    end: tuple[float, Told],
    of_another: tuple[float, Told],
) -> None:
    struck = case("kill", on_crash)
    assert not has_concluded(struck, moments(begin, of_another))
    assert has_concluded(struck, moments(begin, end))


def test_a_stack_that_stops_and_names_the_node_is_right() -> None:
    row = judge(case("kill", "stop"), scene(DIED, ended(), exit_code=1, ended_after_s=0.6))
    assert row.is_right
    assert row.seen == row.case.promise.words == "stack down, exit 1"
    assert row.noticed_s == pytest.approx(0.01)
    assert row.settled_s == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("seen", "fault"),
    [
        (scene(DIED, ended(), exit_code=0, ended_after_s=1), "exit code 0, promised 1"),
        (scene(ended(), exit_code=1, ended_after_s=1), "it was not noticed"),
        (scene(DIED, exit_code=-9, ended_after_s=1), "the launcher told no end"),
        (
            scene(DIED, ended("/other: boom"), exit_code=1, ended_after_s=1),
            "the cause names another one: /other: boom",
        ),
        (
            scene(DIED, ended(origin=""), exit_code=1, ended_after_s=1),
            "the place in the config is another one: none",
        ),
        (
            scene(DIED, ended(), exit_code=1, ended_after_s=12),
            "so after 12.0 s, promised within 10 s: stack down, exit 1",
        ),
        (scene(DIED), "not so within 10 s: stack down, exit 1"),
        (
            scene(DIED, ended(), exit_code=1, ended_after_s=1, left=("python node",)),
            "left behind: python node",
        ),
        (
            scene((0.3, DIED[1]), ended(), exit_code=1, ended_after_s=1),
            "noticed after 0.30 s, promised within 0.1 s",
        ),
    ],
)
def test_a_stop_that_is_not_as_promised_is_told(seen: Scene, fault: str) -> None:
    assert fault in judge(case("kill", "stop"), seen).faults


def test_a_node_that_is_back_with_all_others_untouched_is_right() -> None:
    row = judge(case("kill", "restart"), scene(DIED, RESTARTING, BACK, after=status(pids=ANEW)))
    assert row.is_right
    assert row.seen == "restarted, all active"
    assert row.settled_s == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("seen", "fault"),
    [
        (
            scene(DIED, RESTARTING, RESTARTING, BACK, after=status(pids=ANEW)),
            "restarted 2 times, once is right",
        ),
        (scene(DIED, RESTARTING, BACK, after=status()), f"{ROBOT}: still the process that was hit"),
        (
            scene(DIED, RESTARTING, BACK, after=status(pids={**ANEW, CONTROLLER: 8})),
            f"{CONTROLLER}: started anew, and it was not hit",
        ),
        (
            scene(DIED, RESTARTING, BACK, after=status(pids=ANEW, states={ESTIMATOR: "inactive"})),
            f"{ESTIMATOR}: inactive, not active",
        ),
        (scene(DIED, RESTARTING, BACK), "the launcher does not answer"),
        (scene(DIED, ended(), exit_code=1), "the stack came down"),
    ],
)
def test_a_restart_that_is_not_as_promised_is_told(seen: Scene, fault: str) -> None:
    assert fault in judge(case("kill", "restart"), seen).faults


def test_a_stack_that_goes_on_without_the_node_is_right() -> None:
    after = status(pids=LOST, states={ROBOT: "gone"})
    row = judge(case("kill", "ignore"), scene(DIED, WITHOUT, after=after))
    assert row.is_right
    assert row.seen == "the others run on"


def test_a_stack_that_takes_others_along_is_told() -> None:
    after = status(pids={**LOST, ESTIMATOR: None})
    row = judge(case("kill", "ignore"), scene(DIED, WITHOUT, after=after))
    assert row.faults == (f"{ESTIMATOR}: no process",)


def test_a_frozen_node_that_is_gone_on_without_has_to_be_heard_again() -> None:
    seen = scene(HUNG, WITHOUT, after=status())
    row = judge(case("freeze", "ignore"), seen)
    assert row.faults == (f"{ROBOT}: answers again, and that was not told",)
    again = scene(HUNG, WITHOUT, (3.0, AnswersAgain(node=ROBOT)), after=status())
    assert judge(case("freeze", "ignore"), again).is_right


def test_a_delay_without_a_reaction_is_right_and_with_one_it_is_not() -> None:
    assert judge(case("delay", "stop"), scene(after=status())).seen == "no reaction"
    assert judge(case("delay", "stop"), scene(after=status())).is_right
    row = judge(case("delay", "stop"), scene(HUNG, after=status()))
    assert row.seen == "only told: Hung"
    assert row.faults[0].startswith("no reaction is right, this was one: Hung(")


def test_a_launchers_line_becomes_the_event_that_it_was() -> None:
    moment = Moment(time_s=2.5, event=RESTARTING[1])
    line = json.dumps(event_record(moment.event, moment.time_s))
    assert parse_moment(line) == moment
    for other in ("error: no such thing", '{"event": "Note", "time": 1}', "[1]", "{}"):
        assert parse_moment(other) is None


ROWS = (
    judge(case("kill", "restart"), scene(DIED, RESTARTING, BACK, after=status(pids=ANEW))),
    judge(case("delay", "restart"), scene(HUNG, after=status())),
)


def test_the_table_shows_every_row_and_the_evidence_of_what_is_wrong() -> None:
    table = [line.split("  ") for line in rehearsal_text(ROWS).splitlines()[:3]]
    assert [[cell.strip() for cell in line if cell] for line in table] == [
        ["node", "fault", "promised", "seen", "noticed [s]", "settled [s]"],
        ["robot_0", "kill", ROWS[0].seen, ROWS[0].seen, "0.010", "1.5", "ok"],
        ["robot_0", "delay", "no reaction", "only told: Hung", "1.700", "-", "FAILED"],
    ]
    below = rehearsal_text(ROWS).splitlines()[3:]
    assert below[:2] == ["", "delay robot_0:"]
    assert below[-3:] == ["  see runs/s/launch.log", "", "1 of 2 promises kept"]
    assert rehearsal_text(ROWS[:1]).endswith("\n1 promise kept")


def test_the_table_of_a_terminal_tells_the_same() -> None:
    drawn = rehearsal_table(ROWS, 120)
    assert "\x1b[1;31mFAILED" in drawn
    assert drawn.splitlines()[-1] == "1 of 2 promises kept"
    plain = re.sub(r"\x1b\[[\d;]*m", "", drawn)
    assert re.split(r" {2,}", plain.splitlines()[0].strip()) == [title for title in HEAD if title]


def test_the_rows_for_a_program_say_whether_all_is_right() -> None:
    told = json.loads(rehearsal_json(ROWS))
    assert told["ok"] is False
    assert [row["ok"] for row in told["rows"]] == [True, False]
    assert told["rows"][0]["process"] == ROBOT
