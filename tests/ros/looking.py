"""Run the commands that inspect a ROS graph, for the tests of each command."""

import json
from typing import Any

import pytest

from obk_cli.ros.environment import ros_environment

from .stack import obk


def announce_as_a_stack_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make nodes of this process discoverable as fast as those that a launch has started."""
    for name, value in ros_environment().variables.items():
        monkeypatch.setenv(name, value)


def done(*words: object) -> str:
    result = obk(*words)
    assert result.returncode == 0, (words, result.stdout, result.stderr)
    return result.stdout


def error_of(*words: object, exit_code: int = 1, is_patient: bool = True) -> str:
    result = obk(*words, is_patient=is_patient)
    assert result.returncode == exit_code, (words, result.stdout, result.stderr)
    assert "Traceback" not in result.stderr
    return result.stderr


def reported(*words: object) -> Any:
    return json.loads(done(*words, "--format", "json"))
