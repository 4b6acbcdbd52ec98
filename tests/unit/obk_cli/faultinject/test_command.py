"""The `obk rehearse` command, except for what needs a running stack."""

from pathlib import Path

import pytest

from obk_cli.cli.main import main

DUMMY = Path(__file__).parents[4] / "examples" / "dummy" / "dummy.yaml"
HARDWARE = """\
config: real
robot:
  - is_simulated: false
    pkg: arm
    executable: driver
"""


def obk(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[object, str]:
    """The exit code, and the standard error."""
    with pytest.raises(SystemExit) as ended:
        main(["rehearse", *arguments])
    return ended.value.code, capsys.readouterr().err


def test_the_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["rehearse", "--help"])
    assert "Example: obk rehearse examples/dummy/dummy.yaml" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message", "help_"),
    [
        (("-",), "needs a file", ""),
        ((str(DUMMY), "--fault", "kil"), "`--fault kil`: expected one of `delay`,", "`kill`?"),
        ((str(DUMMY), "--on-crash", "stpo"), "`--on-crash stpo`: expected one of", "`stop`?"),
        ((str(DUMMY), "--node", "contrl_0"), "no such node", "`control_0`"),
    ],
)
def test_impossible_requests_are_misuse_with_the_possible_ones(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str, help_: str
) -> None:
    code, output = obk(capsys, *arguments)
    assert code == 2
    assert message in output
    assert help_ in output


def test_a_config_with_errors_starts_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    code, output = obk(capsys, str(DUMMY), "--set", "onboard.control[0].publishers[0].topic=/x")
    assert code == 1
    assert "error[OBK" in output
    assert not list(tmp_path.iterdir())


def test_hardware_is_rejected_with_a_hint_how_to_simulate_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))
    config = tmp_path / "real.yaml"
    config.write_text(HARDWARE)
    code, output = obk(capsys, str(config), "--ignore", "OBK")
    assert code == 1
    assert f"error: {config}:3:19: the robot /obelisk_robot_0 is hardware" in output
    assert "help: set `is_simulated: true` and a `sim` block" in output
    assert not (tmp_path / "home").exists()
