"""Nodes with the same names, unknown publishers and other message types in ROS domain."""

import math
import os
import signal
import subprocess
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from queue import SimpleQueue

import pytest

from obk_cli.errors import CommandFailedError
from obk_cli.launch import conflicts
from obk_cli.launch.conflicts import (
    control_topics,
    has_hardware,
    refuse_taken_names,
    refuse_unknown_publishers,
    watching_publishers,
    watching_types,
)
from obk_cli.launch.events import InputEvent, UnknownPublisherFound
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.ros.graph import OWN_DISCOVERY_S, UNNAMED
from obk_cli.ros.publisher import ALLOWED_PUBLISHER, is_allowed_publisher

from ..plans import node  # noqa: TID252 - shared by folders of tests

ROBOT = node(
    "obelisk_robot_0",
    "robot",
    subscribes=(Endpoint(topic="/ctrl", msg_type=None),),
    model="m.xml",
)
PLAN = Plan(name="s", nodes=(ROBOT,))


class Graph:
    """Other nodes, as a table."""

    def __init__(self, *others: tuple[str, str]) -> None:
        self.others = others
        self.waited: list[float] = []
        self.viewed = threading.Semaphore(0)

    def taken(self, names: Iterable[str], discovery_s: float) -> tuple[str, ...]:
        return tuple(set(names) & {name for _, name in self.others})

    def foreign_publishers(
        self, topics: Iterable[str], ours: Iterable[str], discovery_s: float
    ) -> tuple[tuple[str, str], ...]:
        self.waited.append(discovery_s)
        self.viewed.release()
        return tuple(s for s in self.others if s[0] in set(topics) and s[1] not in set(ours))


@pytest.fixture(autouse=True)
def _looks_often_and_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conflicts, "PUBLISHERS_PERIOD_S", 0.001)
    monkeypatch.setattr(conflicts, "FOREIGN_DISCOVERY_S", math.inf)


def no_note(text: str) -> None:
    raise AssertionError(text)


def look_twice(graph: Graph) -> None:
    """Wait until the result of the first check has been handled."""
    for _ in range(2):
        assert graph.viewed.acquire(timeout=20)


def test_a_name_of_another_node_is_rejected() -> None:
    with pytest.raises(
        CommandFailedError, match="already in use in ROS domain 7: /obelisk_robot_0"
    ):
        refuse_taken_names(("/obelisk_robot_0",), Graph(("/x", "/obelisk_robot_0")), 7)  # type: ignore[arg-type]


def test_another_publisher_of_robot_commands_is_named() -> None:
    with pytest.raises(CommandFailedError, match="/teleop publishes on /ctrl") as raised:
        refuse_unknown_publishers(PLAN, Graph(("/ctrl", "/teleop")), 7)  # type: ignore[arg-type]
    assert "--allow-foreign" in (raised.value.help or "")


def test_publishers_of_other_topics_and_of_the_plan_are_ignored() -> None:
    refuse_unknown_publishers(PLAN, Graph(("/x", "/teleop"), ("/ctrl", "/obelisk_robot_0")), 7)  # type: ignore[arg-type]


def test_a_publisher_of_an_external_topic_is_accepted() -> None:
    external = replace(PLAN, external_topics=("/ctrl",))
    graph = Graph(("/ctrl", "/teleop"))
    received: SimpleQueue[InputEvent] = SimpleQueue()
    refuse_unknown_publishers(external, graph, 7)  # type: ignore[arg-type]
    with watching_publishers(external, graph, received.put, no_note):  # type: ignore[arg-type]
        look_twice(graph)
    assert received.empty()


def test_for_a_real_robot_the_check_takes_as_long_as_necessary() -> None:
    real = Plan(name="s", nodes=(replace(ROBOT, model=None),))
    assert has_hardware(real)
    assert not has_hardware(PLAN)
    graph = Graph()
    refuse_unknown_publishers(PLAN, graph, 7)  # type: ignore[arg-type]
    refuse_unknown_publishers(real, graph, 7)  # type: ignore[arg-type]
    assert graph.waited == [OWN_DISCOVERY_S, conflicts.FOREIGN_DISCOVERY_S]


def test_one_that_is_found_late_is_reported() -> None:
    received: SimpleQueue[InputEvent] = SimpleQueue()
    with watching_publishers(PLAN, Graph(("/ctrl", "/teleop")), received.put, no_note):  # type: ignore[arg-type]
        assert received.get(timeout=20) == UnknownPublisherFound(topic="/ctrl", node="/teleop")


def test_one_that_starts_during_the_run_is_noted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conflicts, "FOREIGN_DISCOVERY_S", -1.0)
    monkeypatch.setattr(conflicts, "TYPES_PERIOD_S", 0.001)
    received: SimpleQueue[InputEvent] = SimpleQueue()
    noted: list[str] = []
    graph = Graph(("/ctrl", "/teleop"))
    with watching_publishers(PLAN, graph, received.put, noted.append):  # type: ignore[arg-type]
        look_twice(graph)
        look_twice(graph)
    assert received.empty()
    (note,) = noted
    assert "/teleop" in note
    assert "/ctrl" in note


def test_an_unnamed_publisher_is_not_foreign_once_our_nodes_have_started() -> None:
    received: SimpleQueue[InputEvent] = SimpleQueue()
    graph = Graph(("/ctrl", UNNAMED))
    with watching_publishers(PLAN, graph, received.put, no_note):  # type: ignore[arg-type]
        look_twice(graph)
    assert received.empty()


def test_a_command_allowed_to_publish_after_the_start_is_not_foreign(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    received: SimpleQueue[InputEvent] = SimpleQueue()
    with _child() as pid:
        graph = Graph(("/ctrl", f"/{ALLOWED_PUBLISHER}_{pid}"))
        # It started before this launch; whether it commands the robot is a different question.
        with watching_publishers(PLAN, graph, received.put, no_note):  # type: ignore[arg-type]
            assert isinstance(received.get(timeout=20), UnknownPublisherFound)
        monkeypatch.setattr(conflicts, "since_boot_s", lambda: 0.0)
        graph = Graph(*graph.others)
        with watching_publishers(PLAN, graph, received.put, no_note):  # type: ignore[arg-type]
            look_twice(graph)
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            graph.viewed = threading.Semaphore(0)
            look_twice(graph)
        assert received.empty()


def test_a_publisher_of_that_name_with_a_remote_process_is_foreign() -> None:
    with _child() as pid:
        name = f"/{ALLOWED_PUBLISHER}_{pid}"
        assert is_allowed_publisher(name, 0.0)
        assert not is_allowed_publisher(f"/arm{name}", 0.0)
        assert not is_allowed_publisher(f"{name}x", 0.0)
        assert not is_allowed_publisher(f"/teleop_{pid}", 0.0)
    assert not is_allowed_publisher(name, 0.0)


@contextmanager
def _child() -> Iterator[int]:
    """The ID of a process that is running during the test."""
    child = subprocess.Popen(["sleep", "60"])
    try:
        yield child.pid
    finally:
        child.kill()
        child.wait()


def test_the_check_ends_with_the_run() -> None:
    graph = Graph()
    with watching_publishers(PLAN, graph, lambda _: None, no_note):  # type: ignore[arg-type]
        look_twice(graph)
        assert "publishers" in {thread.name for thread in threading.enumerate()}
    assert "publishers" not in {thread.name for thread in threading.enumerate()}


def test_the_robots_topics_are_those_it_listens_to() -> None:
    assert control_topics(PLAN) == ("/ctrl",)


CONTROL, STRING = "obelisk_control_msgs/msg/PositionSetpoint", "std_msgs/msg/String"
TYPES_PLAN = Plan(
    name="s",
    nodes=(
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


class TypesGraph:
    """The results of each check; the last one is repeated."""

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


def reported_of(
    *looks: Mapping[str, Sequence[str]],
    monkeypatch: pytest.MonkeyPatch,
    ends: Sequence[tuple[str, ...]] = (("/a", "/b"),),
) -> list[str]:
    monkeypatch.setattr(conflicts, "TYPES_PERIOD_S", 0.001)
    reported: list[str] = []
    graph = TypesGraph(looks, ends)
    with watching_types(TYPES_PLAN, graph, reported.append):  # type: ignore[arg-type]
        assert graph.is_through.wait(60)
    return reported


def test_another_type_is_reported_once_with_both_types_and_its_node(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    both = {"/ctrl": [CONTROL, STRING]}
    looks = ({"/ctrl": [CONTROL]}, both, {}, both)
    assert reported_of(*looks, monkeypatch=monkeypatch) == [
        f"warning: /ctrl has the type {CONTROL} in this stack and {STRING} in /a, /b: "
        "these nodes do not receive each other's messages"
    ]


@pytest.mark.parametrize(
    ("ends", "who"),
    [([("/a", UNNAMED), (UNNAMED,), ("/a", "/b")], "/a, /b"), ([(UNNAMED,)], UNNAMED)],
    ids=["reported in time", "never reported"],
)
def test_a_nodes_name_is_waited_for_and_the_type_reported_without_it_in_the_end(
    ends: Sequence[tuple[str, ...]], who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (reported,) = reported_of({"/ctrl": [CONTROL, STRING]}, monkeypatch=monkeypatch, ends=ends)
    assert f"and {STRING} in {who}: " in reported


def test_other_topics_and_those_without_a_type_in_the_plan_do_not_matter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = {"/ctrl": [CONTROL], "/own": [STRING, CONTROL], "/x": [STRING, CONTROL]}
    assert reported_of(looks, monkeypatch=monkeypatch) == []
