"""The stack's node: its name, and how it rejects requests."""

import pytest

from obelisk_spec.names import node_name_fault
from obk_cli.launch.state_node import rejection, state_node_name


@pytest.mark.parametrize(
    ("config", "name"),
    [
        ("dummy", "dummy"),
        ("my stack-2", "my_stack_2"),
        ("2d", "_2d"),
        ("läufer/a", "l_ufer_a"),
        ("", "_"),
        ("x" * 300, "x" * 200),
    ],
)
def test_a_configs_name_is_converted_to_a_valid_ros_name(config: str, name: str) -> None:
    assert state_node_name(config) == name
    assert node_name_fault(name) is None


@pytest.mark.parametrize(
    ("state", "possible"),
    [
        ("active", "deactivate, shutdown"),
        ("activating", "none before the stack has finished `activating`"),
        ("unknown", "none before the stack has come up"),
        ("finalized", "none"),
    ],
)
def test_a_rejection_lists_the_possible_values(state: str, possible: str) -> None:
    assert rejection(state, "", 1) == (
        f"the transition `1` is not allowed in the state `{state}`; possible now: {possible}"
    )
