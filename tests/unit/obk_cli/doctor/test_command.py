"""The `obk doctor` command: selected checks, formats, exit codes."""

import json

import pytest

from obk_cli.cli import doctor
from obk_cli.cli.main import main
from obk_cli.doctor.checks import Check
from obk_cli.doctor.finding import error, ok, warning

HEALTHY = Check(name="ros", about="which ROS", find=lambda: (ok("jazzy"),))
WARNS = Check(name="cpu", about="processors", find=lambda: (warning("one", "buy another"),))
FAILS = Check(name="rmw", about="middleware", find=lambda: (error("none", "install one"),))


@pytest.fixture(autouse=True)
def _made_up_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "checks_of", lambda *_: (HEALTHY, WARNS, FAILS))


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(("doctor", *arguments))
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_an_error_is_the_exit_code_and_a_warning_is_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run() == 1
    assert "3 checks: 1 error, 1 warning" in capsys.readouterr().out
    assert run("ros", "cpu") == 0


def test_named_checks_run_alone_in_the_tables_order(capsys: pytest.CaptureFixture[str]) -> None:
    run("cpu", "ros")
    assert [line[:3] for line in capsys.readouterr().out.splitlines()[:2]] == ["ros", "cpu"]


def test_the_list_runs_no_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--list") == 0
    assert capsys.readouterr().out == "ros  which ROS\ncpu  processors\nrmw  middleware\n"
    assert run("cpu", "--list", "--format", "json") == 0
    assert json.loads(capsys.readouterr().out) == [{"name": "cpu", "about": "processors"}]


def test_an_unknown_check_is_reported_with_a_suggestion(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("rwm") == 2
    assert "unknown check `rwm`" in capsys.readouterr().err
