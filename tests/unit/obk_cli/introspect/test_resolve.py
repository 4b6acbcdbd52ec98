"""Waiting times for nodes in a graph that stays empty."""

from pathlib import Path
from typing import Any, cast

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.resolve import find_node, find_topic, settle
from obk_cli.introspect.target import NO_NODES_S, GraphTarget
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.participant import RosParticipant
from obk_cli.runs.folder import Run

RUN = Run(name="dummy", pid=1, started=0.0, domain=7, config="dummy.yaml", nodes=("/arm",))


class EmptyGraph:
    """A graph that stays empty; records the waiting time."""

    def __init__(self) -> None:
        self.waited_s: list[float] = []

    def nodes(self) -> tuple[str, ...]:
        return ()

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        return {}

    def wait_for(self, probe: Any, timeout_s: float) -> None:
        assert probe() is None
        self.waited_s.append(timeout_s)

    def rest(self, seconds: float) -> None:
        self.waited_s.append(seconds)


def place(tmp_path: Path, no_nodes_s: float = NO_NODES_S, *, runs: bool = False) -> GraphTarget:
    variables = {"ROS_DOMAIN_ID": "7", "OBK_HOME": str(tmp_path)}
    environment = RosEnvironment(variables=variables, range="LOCALHOST", notes=())
    folders = {tmp_path / "dummy": RUN} if runs else {}
    return GraphTarget(environment=environment, runs=folders, no_nodes_s=no_nodes_s)


def waited_for(where: GraphTarget, *, wait_s: float | None = None) -> list[float]:
    look = EmptyGraph()
    with pytest.raises(CommandFailedError, match="was found"):
        settle(cast(RosParticipant, look), where, 5.0, wait_s=wait_s)
    return look.waited_s


def test_an_empty_domain_is_known_to_be_empty_soon(tmp_path: Path) -> None:
    assert waited_for(place(tmp_path)) == [1.0]


def test_a_name_is_waited_for_as_long_as_the_user_requests(tmp_path: Path) -> None:
    assert waited_for(place(tmp_path, 20.0)) == [20.0]
    assert waited_for(place(tmp_path), wait_s=3.3) == [3.3, 1.0]


def test_nodes_that_are_known_to_run_are_waited_for(tmp_path: Path) -> None:
    assert waited_for(place(tmp_path, runs=True)) == [5.0]


@pytest.mark.parametrize("name", ["/arm/joints", "joints"])
def test_a_full_name_is_not_waited_for_in_an_empty_graph(tmp_path: Path, name: str) -> None:
    for find in (find_topic, find_node):
        look = EmptyGraph()
        with pytest.raises(CommandFailedError, match="no stack is running"):
            find(cast(RosParticipant, look), place(tmp_path), name, 5.0)
        assert look.waited_s == [1.0]


class Later(EmptyGraph):
    """A stack's node immediately, and another one after a pause."""

    def nodes(self) -> tuple[str, ...]:
        return ("/arm", "/talker") if self.waited_s else ("/arm",)

    def wait_for(self, probe: Any, timeout_s: float) -> Any:
        return probe()

    def settle(self, *_: object) -> bool:
        return True


def test_a_node_outside_the_stack_gets_time_to_announce_itself(tmp_path: Path) -> None:
    look = Later()
    where = place(tmp_path, runs=True)
    assert find_node(cast(RosParticipant, look), where, "talker", 5.0) == "/talker"
    assert look.waited_s == [1.0]
    assert find_node(cast(RosParticipant, Later()), where, "arm", 5.0) == "/arm"
    patient = Later()
    with pytest.raises(CommandFailedError, match="no node `walker`"):
        find_node(cast(RosParticipant, patient), place(tmp_path, 20.0, runs=True), "walker", 5.0)
    assert patient.waited_s == [3.3]


class WithoutArm(Later):
    """The stack's node is missing, because it hangs or has exited."""

    def nodes(self) -> tuple[str, ...]:
        return ("/other",)


def test_a_missing_node_of_the_stack_is_reported_as_such(tmp_path: Path) -> None:
    where = place(tmp_path, runs=True)
    with pytest.raises(CommandFailedError, match="/arm belongs to a running stack"):
        find_node(cast(RosParticipant, WithoutArm()), where, "arm", 5.0)
