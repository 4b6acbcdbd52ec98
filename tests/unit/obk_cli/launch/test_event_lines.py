"""The lines of a run, as text."""

import pytest

from obelisk_spec.runtime_protocol import Rate
from obk_cli.launch.event_lines import LaunchReport, short_name
from obk_cli.launch.events import (
    AnswersAgain,
    Ended,
    Evidence,
    Failed,
    GoesOnWithout,
    Hung,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RateKept,
    RateMoved,
    Restarted,
    Restarting,
    SignalIgnored,
    StackStateChanged,
    StateSeen,
    TransitionEnded,
    WaitingFor,
)
from obk_cli.runs.protocol import Result

CONTROL, ROBOT = "/obelisk_control_0", "/obelisk_robot_0"


def lines_of(*events: object, quiet: bool = False) -> list[str]:
    lines: list[str] = []
    report = LaunchReport((CONTROL, ROBOT), colour=False, quiet=quiet)
    for event in events:
        if isinstance(event, str):
            lines.extend(report.line(ROBOT, event))
        else:
            lines.extend(report.event(event))
    return lines


def test_phases_carry_their_time() -> None:
    assert lines_of(Phase(name="active", seconds=1.234)) == ["[  1.23 s] active"]
    assert lines_of(Phase(name="stopping", seconds=12, detail="SIGINT")) == [
        "[ 12.00 s] stopping (SIGINT)"
    ]


def test_a_transition_reports_node_result_and_time() -> None:
    event = TransitionEnded(node=ROBOT, transition="configure", result="reached", seconds=0.0721)
    assert lines_of(event) == ["  robot_0: configure ok (72 ms)"]


def test_a_rejected_transition_shows_the_nodes_own_message_and_traceback() -> None:
    event = TransitionEnded(
        node=ROBOT,
        transition="configure",
        result="refused",
        seconds=0.001,
        fault="on_configure: ValueError: x\nTraceback (most recent call last):\n  line",
    )
    # The node's own output, which is shown too, has the traceback.
    shown = ["  robot_0: configure FAILED (1 ms)", "    on_configure: ValueError: x"]
    assert lines_of(event) == shown
    assert lines_of(event, quiet=True) == [
        *shown,
        "    Traceback (most recent call last):",
        "      line",
    ]


def test_a_change_from_elsewhere_is_reported() -> None:
    seen = StateSeen(node=CONTROL, state="inactive", transition="deactivate")
    assert lines_of(seen) == ["  control_0: inactive (not requested by this launch)"]


def test_the_way_out_of_a_failure_is_not_reported_as_a_change_from_elsewhere() -> None:
    seen = StateSeen(node=CONTROL, state="unconfigured")
    assert lines_of(seen) == ["  control_0: unconfigured (after its failure)"]


def test_failures_are_reported_with_their_cause() -> None:
    assert lines_of(Failed(node=CONTROL, fault="boom")) == ["  control_0: FAILED", "    boom"]
    assert lines_of(ProcessEnded(process=ROBOT, code=-9)) == [
        "  robot_0: the process was terminated by SIGKILL"
    ]
    assert lines_of(ProcessEnded(process=ROBOT, code=1, text="KeyError: 'x'")) == [
        "  robot_0: the process exited with code 1: KeyError: 'x'"
    ]


def test_the_first_cause_is_shown_first_then_its_origin_then_the_count_of_later_faults() -> None:
    assert lines_of(
        Ended(exit_code=1, cause="a died", consequences=2, origin="dummy.yaml:12:3")
    ) == ["failed: a died", "  defined at dummy.yaml:12:3", "  followed by 2 more failures"]
    assert lines_of(Ended(exit_code=1, cause="a died", consequences=1)) == [
        "failed: a died",
        "  followed by 1 more failure",
    ]
    assert lines_of(Ended(exit_code=0, cause="")) == ["stopped cleanly"]


@pytest.mark.parametrize(
    ("result", "reported"),
    [
        ("already there", "already in that state"),
        ("timed out", "TIMED OUT (72 ms)"),
        ("gone", "GONE (72 ms)"),
        ("rolled back", "rolled back (72 ms)"),
    ],
)
def test_every_end_of_a_transition_has_its_word(result: Result, reported: str) -> None:
    event = TransitionEnded(node=ROBOT, transition="configure", result=result, seconds=0.0721)
    assert lines_of(event) == [f"  robot_0: configure {reported}"]


def test_a_rate_is_reported_when_it_breaks_and_when_it_is_kept_again() -> None:
    rate = Rate(
        name="timer_ctrl",
        expected_hz=1000.0,
        measured_hz=187.4567,
        ticks=1,
        overruns=0,
        late_p50_us=1.0,
        late_p99_us=5120.0,
        late_max_us=9000.0,
    )
    origin = "c.yaml:7:21"
    assert lines_of(
        RateMoved(node=CONTROL, rate=rate),
        RateBroken(node=CONTROL, rate=rate, origin=origin),
        RateBroken(node=CONTROL, rate=rate, origin="", silent_s=3.21),
        RateKept(node=CONTROL, rate=rate),
    ) == [
        "  control_0: RATE: timer_ctrl runs at 187.5 of 1000 Hz (p99 latency 5.12 ms); "
        "set at c.yaml:7:21",
        "  control_0: RATE: timer_ctrl was not reported for 3.2 s, expected 1000 Hz",
        "  control_0: timer_ctrl runs at 187.5 of 1000 Hz again",
    ]


def test_hangs_and_restarts_are_reported() -> None:
    assert lines_of(
        Hung(node=ROBOT, seconds=2.04),
        AnswersAgain(node=ROBOT),
        Restarting(nodes=(ROBOT, CONTROL), wait_s=0.5, attempt=1, attempts=3),
        Restarted(nodes=(ROBOT, CONTROL)),
        GoesOnWithout(nodes=(CONTROL,)),
        WaitingFor(devices=("base", "arm"), nodes=(ROBOT, "/arm/obelisk_control_1")),
    ) == [
        "  robot_0: HUNG: no answer for 2.0 s",
        "  robot_0: answering again",
        "  robot_0, control_0: restart 1 of 3 in 0.5 s",
        "  robot_0, control_0: recovered",
        "  the stack continues without control_0",
        "  waiting for nodes of base, arm: robot_0, arm/control_1",
    ]


def test_ignored_signals_are_shown() -> None:
    event = SignalIgnored(processes=(ROBOT,), signal="SIGINT", seconds=3.0)
    assert lines_of(event) == ["  robot_0: still running 3.0 s after SIGINT"]


def test_evidence_is_shown_if_the_nodes_output_is_not() -> None:
    event = Evidence(node=ROBOT, lines=("\x1b[1mlast words", "Stack (most recent call first):"))
    assert lines_of(event) == []
    assert lines_of(event, quiet=True) == [
        "  robot_0: its last output:",
        "    last words",
        "    Stack (most recent call first):",
    ]


def test_the_stacks_state_is_reported_if_no_phase_reports_it() -> None:
    assert lines_of(
        StackStateChanged(state="activating"),
        Phase(name="active", seconds=1),
        StackStateChanged(state="active"),
        StackStateChanged(state="deactivating"),
        Phase(name="rolling back", seconds=1.5),
        StackStateChanged(state="inactive"),
        Phase(name="stopping", seconds=2),
        StackStateChanged(state="unconfigured"),
    ) == [
        "[  1.00 s] active",
        "  the stack: deactivating",
        "[  1.50 s] rolling back",
        "  the stack: inactive",
        "[  2.00 s] stopping",
    ]


def test_a_shared_process_has_its_own_name() -> None:
    report = LaunchReport((ROBOT,), colour=True, quiet=False)
    assert list(report.event(ProcessStarted(process="/dummy/composed", pid=7))) == [
        "  dummy/composed: process 7"
    ]
    assert list(report.line("/dummy/composed", "hello")) == ["\x1b[2mdummy/composed |\x1b[0m hello"]


def test_a_short_name_keeps_the_namespace() -> None:
    assert short_name("/arm/left/obelisk_control_0") == "arm/left/control_0"


def test_output_follows_the_nodes_name_unless_it_is_quiet() -> None:
    assert lines_of("hello") == ["robot_0   | hello"]
    assert lines_of("hello", quiet=True) == []


def test_colors_of_a_nodes_output_pass_and_end_with_their_line() -> None:
    report = LaunchReport((ROBOT,), colour=True, quiet=False)
    (line,) = report.line(ROBOT, "\x1b[31mred\x1b[2J")
    assert line == "\x1b[36mrobot_0 |\x1b[0m \x1b[31mred\x1b[0m"


def test_the_fault_message_of_a_node_does_not_reach_the_terminal_raw() -> None:
    assert lines_of(Failed(node=ROBOT, fault="\x1b[2Jboom"))[1] == "    boom"
    assert lines_of(ProcessEnded(process=ROBOT, code=1, text="\x1b]0;x\x07y"))[0].endswith("1: y")
