"""What the tests of commands that make files share: a workspace, and how a command is called."""

from functools import partial
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from obk_cli.cli.new import app
from obk_cli.errors import ObkError


def empty_workspace(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace without packages, which becomes the working folder."""
    (folder / "src").mkdir(parents=True)
    monkeypatch.chdir(folder)
    return folder


def printed_by(command: typer.Typer, *arguments: str) -> str:
    """What a command that succeeds prints."""
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused_by(command: typer.Typer, *arguments: str) -> ObkError:
    """Why a command does nothing."""
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, ObkError), result.output
    return result.exception


obk_new = partial(printed_by, app)
refused = partial(refused_by, app)
