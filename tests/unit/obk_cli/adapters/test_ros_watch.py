"""What it means what a node tells of itself."""

import pytest

from obk_cli.adapters.ros_watch import failed_transition, heard_of_passage
from obk_cli.launch.events import StateSeen, TransitionBegun


def test_a_passage_begins_a_transition_ends_one_or_fails() -> None:
    begun = heard_of_passage("/n", "inactive", "activating")
    assert begun == TransitionBegun(node="/n", transition="activate")
    seen = heard_of_passage("/n", "activating", "active")
    assert seen == StateSeen(node="/n", state="active", transition="activate")
    assert heard_of_passage("/n", "activating", "errorprocessing") is None
    recovered = heard_of_passage("/n", "errorprocessing", "unconfigured")
    assert recovered == StateSeen(node="/n", state="unconfigured")


@pytest.mark.parametrize("passed", ["configure", "activate", "shutdown"])
def test_through_these_a_node_comes_only_when_asked(passed: str) -> None:
    assert failed_transition(passed, "on_configure: ValueError: x") == passed


@pytest.mark.parametrize("passed", ["deactivate", "cleanup"])
def test_through_these_it_depends_on_what_failed(passed: str) -> None:
    assert failed_transition(passed, f"on_{passed}: ValueError: x") == passed
    assert failed_transition(passed, "Controller.compute_control: ValueError: x") == ""
    assert failed_transition(passed, "") == passed
