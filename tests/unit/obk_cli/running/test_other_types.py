"""Other message types on a stack's topics are told, once each."""

import threading
from collections.abc import Mapping, Sequence

import pytest

from obk_cli.adapters.ros_graph import UNNAMED
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.running import other_types
from obk_cli.running.other_types import other_types_told

from ..plans import node  # noqa: TID252 - shared by folders of tests

CONTROL, STRING = "obelisk_control_msgs/msg/PositionSetpoint", "std_msgs/msg/String"
PLAN = Plan(
    name="s",
    processes=(
        node(
            "obelisk_robot_0",
            "robot",
            subscribes=(
                Endpoint(topic="/ctrl", msg_type=CONTROL),
                Endpoint(topic="/own", msg_type=None),
            ),
        ),
    ),
)


class Graph:
    """What is found, look by look; the last look is repeated."""

    def __init__(
        self, looks: Sequence[Mapping[str, Sequence[str]]], ends: Sequence[tuple[str, ...]]
    ) -> None:
        self.looks = list(looks)
        self.ends = list(ends)
        self.is_through = threading.Event()
        self.left = len(looks) + len(ends) + 10

    def topic_types(self) -> Mapping[str, Sequence[str]]:
        self.left -= 1
        if self.left <= 0:
            self.is_through.set()
        return self.looks.pop(0) if len(self.looks) > 1 else self.looks[0]

    def ends_of_type(self, topic: str, msg_type: str) -> tuple[str, ...]:
        if (topic, msg_type) != ("/ctrl", STRING):
            return ()
        return self.ends.pop(0) if len(self.ends) > 1 else self.ends[0]


def told_of(
    *looks: Mapping[str, Sequence[str]],
    monkeypatch: pytest.MonkeyPatch,
    ends: Sequence[tuple[str, ...]] = (("/a", "/b"),),
) -> list[str]:
    monkeypatch.setattr(other_types, "LOOK_S", 0.001)
    told: list[str] = []
    graph = Graph(looks, ends)
    with other_types_told(PLAN, graph, told.append):  # type: ignore[arg-type]
        assert graph.is_through.wait(60)
    return told


def test_another_type_is_told_once_with_both_types_and_whose_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    both = {"/ctrl": [CONTROL, STRING]}
    looks = ({"/ctrl": [CONTROL]}, both, {}, both)
    assert told_of(*looks, monkeypatch=monkeypatch) == [
        f"warning: /ctrl is a topic of {CONTROL} here, and /a, /b has it as {STRING}: none of "
        "these messages get through"
    ]


@pytest.mark.parametrize(
    ("ends", "who"),
    [([("/a", UNNAMED), (UNNAMED,), ("/a", "/b")], "/a, /b"), ([(UNNAMED,)], UNNAMED)],
    ids=["told in time", "never told"],
)
def test_a_nodes_name_is_waited_for_and_the_type_told_without_it_in_the_end(
    ends: Sequence[tuple[str, ...]], who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (told,) = told_of({"/ctrl": [CONTROL, STRING]}, monkeypatch=monkeypatch, ends=ends)
    assert f"and {who} has it as {STRING}" in told


def test_other_topics_and_those_without_a_type_in_the_plan_do_not_matter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = {"/ctrl": [CONTROL], "/own": [STRING, CONTROL], "/x": [STRING, CONTROL]}
    assert told_of(looks, monkeypatch=monkeypatch) == []
