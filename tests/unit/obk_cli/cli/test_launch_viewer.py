"""`obk launch --viewer`: requests that are rejected before anything starts."""

from pathlib import Path

import pytest

from obk_cli.cli.main import main

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The error message of a launch of the dummy with invalid options."""
    with pytest.raises(SystemExit) as ended:
        main(("launch", str(DUMMY), *arguments))
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_an_unknown_viewer(capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(capsys, "--viewer", "wbe") == (
        "error: `--viewer wbe`: expected one of `none`, `native`, `web`\n"
        "  help: did you mean `web`?\n"
    )


def test_a_stack_whose_robot_is_not_simulated(capsys: pytest.CaptureFixture[str]) -> None:
    real = ("--set", "onboard.robot[0].is_simulated=False", "--ignore", "OBK")
    message = refused(capsys, "--viewer", "web", *real)
    assert "error: `--viewer web`: no simulated robot in `dummy`\n" in message
