"""Shared code for the tests of commands that create files: a workspace, and calls."""

from functools import partial
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from obk_cli.cli.new import app
from obk_cli.errors import ObkError


def empty_workspace(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace without packages, set as the working folder."""
    (folder / "src").mkdir(parents=True)
    monkeypatch.chdir(folder)
    return folder


def printed_by(command: typer.Typer, *arguments: str) -> str:
    """The output of a successful command."""
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def error_of(command: typer.Typer, *arguments: str) -> ObkError:
    """The error message of a failed command."""
    result = CliRunner().invoke(command, arguments)
    assert isinstance(result.exception, ObkError), result.output
    return result.exception


obk_new = partial(printed_by, app)
refused = partial(error_of, app)
