"""Reports of findings, as text and as JSON."""

import json

from obk_cli.cli.doctor import doctor_json, doctor_text
from obk_cli.doctor.checks import Answer
from obk_cli.doctor.finding import error, note, ok, warning

ANSWERS = (
    Answer(check="ros", findings=(ok("jazzy"), note("humble, too")), seconds=0.1),
    Answer(check="rmw", findings=(error("none", "install one", rmw=None),), seconds=0.25),
    Answer(check="cpu", findings=(warning("one", "buy another"),), seconds=0.0),
)


def test_each_finding_is_a_line_followed_by_its_fix() -> None:
    assert doctor_text(ANSWERS, colour=False) == (
        "ros  ok       jazzy\n"
        "     note     humble, too\n"
        "rmw  error    none\n"
        "              fix: install one\n"
        "cpu  warning  one\n"
        "              fix: buy another\n"
        "\n"
        "3 checks: 1 error, 1 warning, 1 note"
    )


def test_the_sum_of_nothing_but_good_is_short() -> None:
    text = doctor_text(ANSWERS[:0], colour=False)
    assert text.endswith("0 checks: no problems")


def test_only_a_colored_report_has_colors() -> None:
    assert "\x1b[31merror" in doctor_text(ANSWERS, colour=True)


def test_a_program_gets_all_that_was_measured() -> None:
    reported = json.loads(doctor_json(ANSWERS))
    assert reported["counts"] == {"error": 1, "warning": 1, "note": 1, "ok": 1}
    assert reported["findings"][2] == {
        "check": "rmw",
        "severity": "error",
        "message": "none",
        "fix": "install one",
        "facts": {"rmw": None},
    }
    assert reported["seconds"] == {"ros": 0.1, "rmw": 0.25, "cpu": 0.0}
