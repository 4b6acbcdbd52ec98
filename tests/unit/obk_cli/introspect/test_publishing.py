"""Checks before a message is published, in graphs that other nodes join."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.publishing import (
    Publication,
    refuse_robot_commands,
    topic_to_publish,
    wait_for_subscribers,
)
from obk_cli.introspect.target import GraphTarget
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.ros.graph import GraphEndpoint, TopicInfo
from obk_cli.ros.raw_subscription import OfferedQos
from obk_cli.runs.folder import Run

from ..plans import node  # noqa: TID252 - shared by folders of tests

RUN = Run(name="arm", pid=1, started=0.0, domain=7, config="arm.yaml", nodes=("/n0",))
ROBOT = "/left/obelisk_robot_0"


def place(*runs: str) -> GraphTarget:
    """The location of the runs, whose folders are empty."""
    folders = {Path("gone", run): RUN for run in runs}
    return GraphTarget(
        environment=cast(Any, SimpleNamespace(domain=7)), runs=folders, no_nodes_s=1.0
    )


def wanted(topic: str = "state", **more: Any) -> Publication:
    """A publication of `{count: 1}`."""
    usual: Mapping[str, Any] = {
        "msg_type": None,
        "message": {"count": 1},
        "subscribers": 1,
        "timeout_s": 60.0,
        "may_move": False,
    }
    return Publication(topic=topic, **{**usual, **more})


class Look:
    """A graph with one topic and one more subscriber at each check."""

    def __init__(self, *listeners: tuple[str, str]) -> None:
        self._listeners = listeners
        self.looks = 0

    def nodes(self) -> tuple[str, ...]:
        return ("/n0",)

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        return {"/arm/state": ("pkg/msg/State",)}

    def topic(self, name: str) -> TopicInfo:
        qos = cast(OfferedQos, None)
        ends = tuple(
            GraphEndpoint(node=node, role="subscription", msg_type=kind, qos=qos)
            for node, kind in self._listeners[: self.looks]
        )
        return TopicInfo(name=name, msg_types=("pkg/msg/State",), subscriptions=ends)

    def settle(self, *_: object) -> bool:
        return True

    def rest(self, _seconds: float) -> None:
        pass

    def wait_for(self, probe: Callable[[], object], _timeout_s: float) -> object:
        for _ in range(10):
            if (found := probe()) is not None:
                return found
            self.looks += 1
        return None


def wait(look: Look, publication: Publication) -> None:
    """Wait for subscribers of the type."""

    def count() -> int:
        return sum(end.msg_type == "pkg/msg/State" for end in look.topic("/a").subscriptions)

    wait_for_subscribers(cast(Any, look), "/a", "pkg/msg/State", publication, count)


def test_subscribers_are_waited_for() -> None:
    look = Look(("/b", "pkg/msg/State"), ("/c", "pkg/msg/Other"), ("/d", "pkg/msg/State"))
    wait(look, wanted(subscribers=2))
    assert look.looks == 3
    wait(Look(), wanted(subscribers=0))
    with pytest.raises(
        CommandFailedError, match=r"0 of 1 subscribers of /a were found within 60 s"
    ):
        wait(Look(), wanted())


def test_late_subscribers_of_another_type_are_not_waited_for() -> None:
    look = Look(("/b", "pkg/msg/Other"), ("/c", "pkg/msg/Other"))
    with pytest.raises(CommandFailedError, match="/a has the type pkg/msg/Other, not"):
        wait(look, wanted())
    assert look.looks == 1


def test_an_unused_topic_needs_a_name_and_a_type() -> None:
    look, new = cast(Any, Look()), wanted("/new", msg_type="pkg/msg/Empty")
    seen, kind = topic_to_publish(look, place(), new)
    assert (seen.name, kind) == ("/new", "pkg/msg/Empty")
    with pytest.raises(MisuseError, match="`/a//b` is not a topic"):
        topic_to_publish(look, place(), wanted("/a//b", msg_type="pkg/msg/Empty"))
    with pytest.raises(CommandFailedError, match="no topic `/new`"):
        topic_to_publish(look, place(), wanted("/new"))


def test_a_message_of_another_type_than_the_subscribers_is_rejected() -> None:
    look = Look(("/b", "pkg/msg/Other"))
    look.looks = 1
    with pytest.raises(CommandFailedError, match="has the type pkg/msg/Other"):
        topic_to_publish(cast(Any, look), place(), wanted(msg_type="pkg/msg/State"))


def test_a_topic_with_a_robot_as_subscriber_is_rejected() -> None:
    look = Look((ROBOT, "pkg/msg/State"))
    refuse_robot_commands(look.topic("/arm/state"), place(), "--allow-foreign")
    look.looks = 1
    with pytest.raises(CommandFailedError, match=f"/arm/state commands `{ROBOT}`"):
        refuse_robot_commands(look.topic("/arm/state"), place(), "--allow-foreign")


def test_the_robots_of_every_stack_here_count_before_they_subscribe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = node("r", "robot", subscribes=(Endpoint(topic="/arm/state", msg_type=None),))
    plans = {"a": Plan(name="a", nodes=()), "b": Plan(name="b", nodes=(robot,))}
    monkeypatch.setattr("obk_cli.introspect.target.plan_of_run", lambda folder: plans[folder.name])
    topic = Look().topic("/arm/state")
    refuse_robot_commands(topic, place("a"), "--allow-foreign")
    with pytest.raises(CommandFailedError, match="/arm/state commands `/r`"):
        refuse_robot_commands(topic, place("a", "b"), "--allow-foreign")
