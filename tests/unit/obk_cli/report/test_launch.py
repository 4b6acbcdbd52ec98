"""Lines of a run for a person."""

from obk_cli.launch.events import (
    Ended,
    Failed,
    Phase,
    ProcessEnded,
    StateSeen,
    TransitionEnded,
)
from obk_cli.report.launch import LaunchReport

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


def test_a_transition_tells_node_result_and_time() -> None:
    event = TransitionEnded(node=ROBOT, transition="configure", result="reached", seconds=0.0721)
    assert lines_of(event) == ["  robot_0: configure ok (72 ms)"]


def test_a_refused_transition_shows_the_nodes_own_words_and_traceback() -> None:
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


def test_a_change_from_elsewhere_is_told() -> None:
    assert lines_of(StateSeen(node=CONTROL, state="inactive")) == [
        "  control_0: inactive (not asked for here)"
    ]


def test_failures_are_told_with_their_cause() -> None:
    assert lines_of(Failed(node=CONTROL, fault="boom")) == ["  control_0: FAILED", "    boom"]
    assert lines_of(ProcessEnded(node=ROBOT, code=-9)) == [
        "  robot_0: the process was ended by SIGKILL"
    ]
    assert lines_of(ProcessEnded(node=ROBOT, code=1, text="KeyError: 'x'")) == [
        "  robot_0: the process exited with code 1: KeyError: 'x'"
    ]
    assert lines_of(Ended(exit_code=1, cause="a died", consequences=2)) == [
        "failed: a died (and 2 more after it)"
    ]
    assert lines_of(Ended(exit_code=0, cause="")) == ["ended in order"]


def test_output_stands_behind_the_nodes_name_unless_it_is_quiet() -> None:
    assert lines_of("hello") == ["robot_0   | hello"]
    assert lines_of("hello", quiet=True) == []


def test_colours_of_a_nodes_output_pass_and_end_with_their_line() -> None:
    report = LaunchReport((ROBOT,), colour=True, quiet=False)
    (line,) = report.line(ROBOT, "\x1b[31mred\x1b[2J")
    assert line == "\x1b[36mrobot_0 |\x1b[0m \x1b[31mred\x1b[0m"


def test_what_a_node_says_of_its_fault_does_not_reach_the_terminal_raw() -> None:
    assert lines_of(Failed(node=ROBOT, fault="\x1b[2Jboom"))[1] == "    boom"
    assert lines_of(ProcessEnded(node=ROBOT, code=1, text="\x1b]0;x\x07y"))[0].endswith("1: y")
