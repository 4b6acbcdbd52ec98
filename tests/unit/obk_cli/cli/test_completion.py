"""Shell completion of command lines."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import shellingham
from click.shell_completion import ShellComplete

from obk_cli.cli.commands import VERBS, root_command
from obk_cli.cli.main import main


@pytest.fixture(autouse=True)
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the runs, with two that have ended."""
    monkeypatch.setenv("OBK_HOME", str(tmp_path))
    for name in ("arm_20260102_030405", "arm_20260102_030406", "dummy_20260102_030405"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    return tmp_path / "runs"


def offered(*words: str) -> list[str]:
    """The completions of the last word."""
    shell = ShellComplete(root_command(), {}, "obk", "_OBK_COMPLETE")
    return [item.value for item in shell.get_completions(list(words[:-1]), words[-1])]


def test_commands_and_the_commands_below_them() -> None:
    assert offered("") == list(VERBS)
    assert offered("val") == ["validate"]
    assert offered("topic", "e") == ["echo"]


def test_options_of_a_command() -> None:
    assert offered("validate", "--f") == ["--format", "--fix", "--for-test"]
    assert "--version" in offered("--")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("validate", "--format", ""), ["github", "json", "sarif", "text"]),
        (("launch", "--network", "l"), ["lan", "localhost"]),
        (("lifecycle", "ac"), ["activate"]),
        (("topic", "list", "--format", "j"), ["json"]),
    ],
)
def test_the_completions_are_those_in_the_help(words: tuple[str, ...], expected: list[str]) -> None:
    assert offered(*words) == expected


def test_the_codes_of_rules() -> None:
    assert offered("explain", "obk00") == [f"OBK00{n}" for n in range(1, 10)]
    assert offered("validate", "--ignore", "OBK303") == ["OBK303"]


def test_runs_by_their_configs_and_by_their_folders() -> None:
    assert offered("logs", "") == ["arm", "dummy"]
    assert offered("logs", "arm_") == ["arm_20260102_030405", "arm_20260102_030406"]
    assert offered("stop", "") == []


def test_the_names_of_files_are_left_to_the_shell() -> None:
    assert offered("validate", "my") == []
    assert offered("plot", "run") == []


SCRIPTS = {
    "bash": """
        eval "$(obk --show-completion bash)"
        COMP_WORDS=(obk lifecycle dea) COMP_CWORD=2
        _obk_completion obk
        echo "${COMPREPLY[@]}"
    """,
    "zsh": """
        compdef() { :; }
        _arguments() { print -r -- "$@"; }
        eval "$(obk --show-completion zsh)"
        words=(obk lifecycle dea) CURRENT=3
        _obk_completion
    """,
    "fish": """
        obk --show-completion fish | source
        complete --do-complete 'obk lifecycle dea'
    """,
}


@pytest.mark.parametrize("shell", SCRIPTS)
def test_a_shell_is_reported(shell: str, tmp_path: Path) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [program, "-c", SCRIPTS[shell]],
        env={**os.environ, "PATH": path, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "deactivate" in done.stdout
    assert " activate" not in done.stdout


def refusal(option: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main([option])
    assert ended.value.code == 1
    return capsys.readouterr().err


@pytest.mark.parametrize("option", ["--install-completion", "--show-completion"])
def test_without_a_shell_it_reports_where_to_type_the_command(
    option: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def detect() -> tuple[str, str]:
        raise shellingham.ShellDetectionFailure

    monkeypatch.setattr(shellingham, "detect_shell", detect)
    assert refusal(option, capsys).startswith(
        "error: obk was not started from a supported shell\n  help: run it in bash, "
    )


def test_a_home_that_cannot_be_written_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = tmp_path / "home"
    home.touch()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setattr(shellingham, "detect_shell", lambda: ("bash", "/bin/bash"))
    assert f"error: `{home}` cannot be written: " in refusal("--install-completion", capsys)
