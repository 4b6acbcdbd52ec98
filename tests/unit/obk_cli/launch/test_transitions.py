"""The lifecycle with ROS's own numbers."""

import pytest
from lifecycle_msgs.msg import State, Transition

from obk_cli.launch.transitions import (
    EDGES,
    PASSED,
    STATES,
    Edge,
    edge_between,
    edges_from,
    find_edge,
)
from obk_cli.runs.lifecycle import RESTING, TRANSITIONS


def test_possible_requests_are_those_known_to_the_launcher() -> None:
    asked = {(edge.label, edge.start) for state in RESTING for edge in edges_from(state)}
    assert asked == {(t.name, start) for t in TRANSITIONS.values() for start in t.starts}
    for name, transition in TRANSITIONS.items():
        passed = next(state for state, label in PASSED.items() if label == name)
        success = edge_between(passed, transition.goal)
        assert success is not None
        assert success.label == "transition_success"


def test_states_have_the_numbers_of_ros() -> None:
    constants = (name for name in dir(State) if "_STATE_" in name)
    assert {
        name.rpartition("STATE_")[2].lower(): getattr(State, name) for name in constants
    } == STATES


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: f"{edge.start}-{edge.goal}")
def test_edges_have_the_numbers_of_ros(edge: Edge) -> None:
    if edge.start in PASSED:
        outcome = edge.label.removeprefix("transition_")
        name = f"ON_{PASSED[edge.start]}_{outcome}"
    else:
        name = f"{edge.start}_shutdown" if edge.label == "shutdown" else edge.label
    assert edge.number == getattr(Transition, f"TRANSITION_{name.upper()}")


def test_every_edge_connects_known_states_and_has_its_own_number() -> None:
    assert all(edge.start in STATES and edge.goal in STATES for edge in EDGES)
    assert len({edge.number for edge in EDGES}) == len(EDGES)


@pytest.mark.parametrize(
    ("state", "label", "number", "found"),
    [
        ("inactive", "activate", 0, 3),
        ("inactive", "", 3, 3),
        ("active", "shutdown", 0, 7),
        ("unconfigured", "shutdown", 7, 5),
        ("unconfigured", "", 7, None),
        ("inactive", "fly", 3, None),
        ("activating", "", 3, None),
        ("inactive", "", 0, None),
    ],
)
def test_a_request_means_an_edge_from_the_present_state_by_label_first(
    state: str, label: str, number: int, found: int | None
) -> None:
    edge = find_edge(state, label, number)
    assert (edge.number if edge else None) == found
