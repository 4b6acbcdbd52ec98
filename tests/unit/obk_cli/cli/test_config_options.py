"""When output is colored."""

import sys

import pytest

from obk_cli.cli.config_options import wants_colour
from obk_cli.errors import MisuseError


class Stdout:
    def __init__(self, is_terminal: bool) -> None:
        self.isatty = lambda: is_terminal


@pytest.mark.parametrize(
    ("choice", "is_terminal", "variables", "wanted"),
    [
        ("auto", True, {"TERM": "xterm"}, True),
        ("auto", True, {"TERM": "xterm", "NO_COLOR": ""}, True),
        ("auto", True, {"TERM": "xterm", "NO_COLOR": "1"}, False),
        ("auto", True, {"TERM": "dumb"}, False),
        ("auto", False, {"TERM": "xterm"}, False),
        ("always", False, {"TERM": "dumb", "NO_COLOR": "1"}, True),
        ("never", True, {"TERM": "xterm"}, False),
    ],
)
def test_color_is_for_terminals_that_can_unless_it_is_chosen(
    monkeypatch: pytest.MonkeyPatch,
    choice: str,
    is_terminal: bool,
    variables: dict[str, str],
    wanted: bool,
) -> None:
    for name in ("TERM", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stdout", Stdout(is_terminal))
    assert wants_colour(choice) is wanted


def test_an_invalid_choice_is_rejected() -> None:
    with pytest.raises(MisuseError, match="expected `auto`, `always` or `never`"):
        wants_colour("yes")
