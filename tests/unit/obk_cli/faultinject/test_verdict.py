"""Verdicts on cases, and how they are shown."""

import json
import re

import pytest

from obk_cli.cli.rehearse import HEAD, rehearsal_json, rehearsal_table, rehearsal_text
from obk_cli.faultinject.verdict import (
    Observation,
    TimedEvent,
    has_concluded,
    parse_event,
    verdict_of,
)
from obk_cli.launch.event_lines import event_record
from obk_cli.launch.events import (
    AnswersAgain,
    Ended,
    GoesOnWithout,
    Hung,
    OutputEvent,
    ProcessEnded,
    Restarted,
    Restarting,
)
from obk_cli.plan.plan import OnCrash

from .made_up import CONTROLLER, ESTIMATOR, ROBOT, case, events, observation, status

DIED = (0.01, ProcessEnded(process=ROBOT, code=-9))
HUNG = (1.7, Hung(node=ROBOT, seconds=1.7))
RESTARTING = (0.1, Restarting(nodes=(ROBOT,), wait_s=0.1, attempt=1, attempts=5))
BACK = (1.5, Restarted(nodes=(ROBOT,)))
WITHOUT = (0.1, GoesOnWithout(nodes=(ROBOT,)))
RESTARTED = {ROBOT: 9}
LOST: dict[str, int | None] = {ROBOT: None}


def ended(
    cause: str = f"{ROBOT}: the process was terminated by SIGKILL", origin: str = "c.yaml:1:1"
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
def test_a_reaction_is_over_when_the_launcher_has_reported_its_end(
    on_crash: OnCrash,
    begin: tuple[float, OutputEvent],
    end: tuple[float, OutputEvent],
    of_another: tuple[float, OutputEvent],
) -> None:
    struck = case("kill", on_crash)
    assert not has_concluded(struck, events(begin, of_another))
    assert has_concluded(struck, events(begin, end))


def test_a_stack_that_stops_and_names_the_node_is_correct() -> None:
    verdict = verdict_of(
        case("kill", "stop"), observation(DIED, ended(), exit_code=1, ended_after_s=0.6)
    )
    assert verdict.is_right
    assert verdict.observed == verdict.case.expectation.summary == "stack down, exit 1"
    assert verdict.detected_s == pytest.approx(0.01)
    assert verdict.settled_s == pytest.approx(0.6)


def test_a_failure_of_a_shared_process_need_not_have_a_location() -> None:
    died = (0.01, ProcessEnded(process="/s/composed", code=-9))
    end = ended("/s/composed: the process was terminated by SIGKILL", origin="")
    seen = observation(died, end, exit_code=1, ended_after_s=0.6)
    assert verdict_of(case("kill", "stop", ROBOT, CONTROLLER), seen).is_right


@pytest.mark.parametrize(
    ("seen", "fault"),
    [
        (observation(DIED, ended(), exit_code=0, ended_after_s=1), "exit code 0"),
        (observation(ended(), exit_code=1, ended_after_s=1), "not detected"),
        (observation(DIED, exit_code=-9, ended_after_s=1), "did not report"),
        (
            observation(DIED, ended("/other: boom"), exit_code=1, ended_after_s=1),
            "/other: boom",
        ),
        (
            observation(DIED, ended(origin=""), exit_code=1, ended_after_s=1),
            "location",
        ),
        (
            observation(DIED, ended(), exit_code=1, ended_after_s=12),
            "after 12.0 s",
        ),
        (observation(DIED), "not settled"),
        (
            observation(DIED, ended(), exit_code=1, ended_after_s=1, left=("python node",)),
            ": python node",
        ),
        (
            observation((0.3, DIED[1]), ended(), exit_code=1, ended_after_s=1),
            "after 0.30 s",
        ),
    ],
)
def test_a_stop_that_is_not_as_expected_is_reported(seen: Observation, fault: str) -> None:
    assert any(fault in one for one in verdict_of(case("kill", "stop"), seen).faults)


def test_a_restarted_node_with_all_others_untouched_is_correct() -> None:
    verdict = verdict_of(
        case("kill", "restart"), observation(DIED, RESTARTING, BACK, after=status(pids=RESTARTED))
    )
    assert verdict.is_right
    assert verdict.observed == "restarted, all active"
    assert verdict.settled_s == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("seen", "fault"),
    [
        (
            observation(DIED, RESTARTING, RESTARTING, BACK, after=status(pids=RESTARTED)),
            "restarted 2 times",
        ),
        (
            observation(DIED, RESTARTING, BACK, after=status()),
            f"{ROBOT}: still",
        ),
        (
            observation(DIED, RESTARTING, BACK, after=status(pids={**RESTARTED, CONTROLLER: 8})),
            f"{CONTROLLER}: was restarted",
        ),
        (
            observation(
                DIED, RESTARTING, BACK, after=status(pids=RESTARTED, states={ESTIMATOR: "inactive"})
            ),
            f"{ESTIMATOR}: inactive, not active",
        ),
        (observation(DIED, RESTARTING, BACK), "does not respond"),
        (observation(DIED, ended(), exit_code=1), "shut down"),
    ],
)
def test_a_restart_that_is_not_as_expected_is_reported(seen: Observation, fault: str) -> None:
    assert any(fault in one for one in verdict_of(case("kill", "restart"), seen).faults)


def test_a_stack_that_continues_without_the_node_is_correct() -> None:
    after = status(pids=LOST, states={ROBOT: "gone"})
    verdict = verdict_of(case("kill", "ignore"), observation(DIED, WITHOUT, after=after))
    assert verdict.is_right
    assert verdict.observed == verdict.case.expectation.summary


def test_a_stack_that_takes_others_along_is_reported() -> None:
    after = status(pids={**LOST, ESTIMATOR: None})
    verdict = verdict_of(case("kill", "ignore"), observation(DIED, WITHOUT, after=after))
    assert verdict.faults == (f"{ESTIMATOR}: no process",)


def test_a_frozen_ignored_node_must_be_received_again() -> None:
    seen = observation(HUNG, WITHOUT, after=status())
    verdict = verdict_of(case("freeze", "ignore"), seen)
    (fault,) = verdict.faults
    assert fault.startswith(f"{ROBOT}: ")
    again = observation(HUNG, WITHOUT, (3.0, AnswersAgain(node=ROBOT)), after=status())
    assert verdict_of(case("freeze", "ignore"), again).is_right


def test_a_delay_without_a_reaction_is_correct_and_with_one_it_is_not() -> None:
    assert verdict_of(case("delay", "stop"), observation(after=status())).observed == "no reaction"
    assert verdict_of(case("delay", "stop"), observation(after=status())).is_right
    verdict = verdict_of(case("delay", "stop"), observation(HUNG, after=status()))
    assert verdict.observed == "reported only: Hung"
    assert "Hung(" in verdict.faults[0]


def test_a_launchers_line_is_parsed_to_its_event() -> None:
    event = TimedEvent(time_s=2.5, event=RESTARTING[1])
    line = json.dumps(event_record(event.event, event.time_s))
    assert parse_event(line) == event
    for other in ("error: no such thing", '{"event": "Note", "time": 1}', "[1]", "{}"):
        assert parse_event(other) is None


VERDICTS = (
    verdict_of(
        case("kill", "restart"), observation(DIED, RESTARTING, BACK, after=status(pids=RESTARTED))
    ),
    verdict_of(case("delay", "restart"), observation(HUNG, after=status())),
)


def test_the_table_shows_every_row_and_the_evidence_of_faults() -> None:
    table = [line.split("  ") for line in rehearsal_text(VERDICTS).splitlines()[:3]]
    assert [[cell.strip() for cell in line if cell] for line in table] == [
        ["node", "fault", "expected", "observed", "detected [s]", "settled [s]"],
        ["robot_0", "kill", VERDICTS[0].observed, VERDICTS[0].observed, "0.010", "1.5", "ok"],
        ["robot_0", "delay", "no reaction", "reported only: Hung", "1.700", "-", "FAILED"],
    ]
    below = rehearsal_text(VERDICTS).splitlines()[3:]
    assert below[:2] == ["", "delay robot_0:"]
    assert below[-3:] == ["  see runs/s/launch.log", "", "1 of 2 expectations met"]
    assert rehearsal_text(VERDICTS[:1]).endswith("\n1 expectation met")


def test_the_table_of_a_terminal_reports_the_same() -> None:
    drawn = rehearsal_table(VERDICTS, 120)
    assert "\x1b[1;31mFAILED" in drawn
    assert drawn.splitlines()[-1] == "1 of 2 expectations met"
    plain = re.sub(r"\x1b\[[\d;]*m", "", drawn)
    assert re.split(r" {2,}", plain.splitlines()[0].strip()) == [title for title in HEAD if title]


def test_the_json_rows_state_whether_all_is_correct() -> None:
    reported = json.loads(rehearsal_json(VERDICTS))
    assert reported["ok"] is False
    assert [verdict["ok"] for verdict in reported["rows"]] == [True, False]
    assert reported["rows"][0]["process"] == ROBOT
