"""Whose fault it was that a node went to error processing."""

import pytest

from obk_cli.adapters.ros_lifecycle import failed_transition


@pytest.mark.parametrize("passed", ["configure", "activate", "shutdown"])
def test_through_these_a_node_comes_only_when_asked(passed: str) -> None:
    assert failed_transition(passed, "on_configure: ValueError: x") == passed


@pytest.mark.parametrize("passed", ["deactivate", "cleanup"])
def test_through_these_it_depends_on_what_failed(passed: str) -> None:
    assert failed_transition(passed, f"on_{passed}: ValueError: x") == passed
    assert failed_transition(passed, "Controller.compute_control: ValueError: x") == ""
    assert failed_transition(passed, "") == passed
