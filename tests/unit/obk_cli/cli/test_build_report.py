from pathlib import Path

import pytest

from obk_cli.cli.build import report_problems, showing_progress
from obk_interfaces import DefinitionProblem, Progress


def step(name: str, subject: str, done: int, total: int) -> Progress:
    return Progress(step=name, subject=subject, done=done, total=total)  # type: ignore[arg-type]


STEPS = (
    step("generate", "a_msgs", 1, 2),
    step("unchanged", "b_msgs", 2, 2),
    step("compile", "", 1, 2),
    step("compile", "", 2, 2),
    step("link", "a_msgs", 1, 1),
    step("install", "a_msgs", 1, 1),
)


def test_elsewhere_than_on_a_terminal_each_step_is_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with showing_progress(is_terminal=False) as show:
        for one in STEPS:
            show(one)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "generated  a_msgs",
        "compiled   2 units",
        "linked     a_msgs",
    ]


def test_a_terminal_shows_nothing_if_nothing_is_done(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with showing_progress(is_terminal=True):
        pass
    assert capsys.readouterr() == ("", "")


def test_a_problem_is_shown_with_its_line_underlined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "A.msg"
    file.write_text("# a\nfloat64\tshort 1\n")
    problem = DefinitionProblem(path=file, line=2, column=9, sentence="no", help="yes")
    assert report_problems([problem], colour=False).splitlines() == [
        "A.msg:2:9: error: no",
        "  2 | float64\tshort 1",
        "    |        \t^^^^^",
        "  help: yes",
    ]
    assert "\x1b[31m" in report_problems([problem], colour=True)
