"""What the tests of `obk new` share: a workspace to stand in, and the command."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from obk_cli.cli.new import app
from obk_cli.errors import ObkError


def empty_workspace(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace without packages, which becomes the working folder."""
    (folder / "src").mkdir(parents=True)
    monkeypatch.chdir(folder)
    return folder


def obk_new(*arguments: str) -> str:
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def refused(*arguments: str) -> ObkError:
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, ObkError), result.output
    return result.exception
