"""What has to hold before a message is published, against graphs that others come into."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.launch.runs import Run
from obk_cli.looking import errands
from obk_cli.looking.errands import publish_by_launcher
from obk_cli.looking.graph import End, TopicSeen
from obk_cli.looking.place import Place
from obk_cli.looking.publishing import (
    Publication,
    Published,
    topic_to_publish,
    wait_for_subscribers,
)
from obk_cli.plan.plan import Endpoint, Plan
from obk_cli.recording.qos import Offer

from ..plans import node  # noqa: TID252 - shared by folders of tests
from .definitions import FIELDS

TYPES = {**FIELDS, "pkg/msg/State": FIELDS["pkg/State"]}
RUN = Run(name="arm", pid=1, started=0.0, domain=7, config="arm.yaml", nodes=("/n0",))
ROBOT = "/left/obelisk_robot_0"


def place(*runs: str) -> Place:
    """Where these runs are, whose folders tell nothing."""
    folders = {Path("gone", run): RUN for run in runs}
    return Place(environment=cast(Any, SimpleNamespace(domain=7)), runs=folders, nobody_s=1.0)


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
    """A graph with one topic, which one more listens to at each look; a launcher's, too."""

    def __init__(self, *listeners: tuple[str, str], confirmed: bool | None = True) -> None:
        self._listeners = listeners
        self._confirmed = confirmed
        self.looks = 0
        self.published: list[tuple[Any, ...]] = []

    def nodes(self) -> tuple[str, ...]:
        return ("/n0",)

    def topic_types(self) -> dict[str, tuple[str, ...]]:
        return {"/arm/state": ("pkg/msg/State",)}

    def topic(self, name: str) -> TopicSeen:
        qos = cast(Offer, None)
        ends = tuple(
            End(node=node, role="subscription", msg_type=kind, qos=qos)
            for node, kind in self._listeners[: self.looks]
        )
        return TopicSeen(name=name, msg_types=("pkg/msg/State",), subscriptions=ends)

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

    def has_type(self, name: str) -> bool:
        return name in TYPES

    def fields_of(self, name: str) -> Mapping[str, str]:
        return TYPES[name]

    def publish(self, *question: Any) -> bool | None:
        self.published.append(question)
        return self._confirmed


def wait(look: Look, publication: Publication) -> None:
    """Wait for subscribers of the type, as many as listen."""

    def count() -> int:
        return sum(end.msg_type == "pkg/msg/State" for end in look.topic("/a").subscriptions)

    wait_for_subscribers(cast(Any, look), "/a", "pkg/msg/State", publication, count)


def launcher(monkeypatch: pytest.MonkeyPatch, look: Look | None) -> None:
    """Have this launcher in every place; None: none."""
    monkeypatch.setattr(errands, "ask_launcher", lambda _: look)


def test_subscribers_are_waited_for() -> None:
    look = Look(("/b", "pkg/msg/State"), ("/c", "pkg/msg/Other"), ("/d", "pkg/msg/State"))
    wait(look, wanted(subscribers=2))
    assert look.looks == 3
    wait(Look(), wanted(subscribers=0))
    with pytest.raises(CommandFailedError, match=r"0 of 1 subscribers of /a came within 60 s"):
        wait(Look(), wanted())


def test_subscribers_that_come_late_and_want_another_type_are_not_waited_with() -> None:
    look = Look(("/b", "pkg/msg/Other"), ("/c", "pkg/msg/Other"))
    with pytest.raises(CommandFailedError, match="/a is of the type pkg/msg/Other, not"):
        wait(look, wanted())
    assert look.looks == 1


def test_a_topic_that_nobody_has_needs_a_name_and_a_type() -> None:
    look, new = cast(Any, Look()), wanted("/new", msg_type="pkg/msg/Empty")
    seen, kind = topic_to_publish(look, place(), new)
    assert (seen.name, kind) == ("/new", "pkg/msg/Empty")
    with pytest.raises(MisuseError, match="`/a//b` is no topic"):
        topic_to_publish(look, place(), wanted("/a//b", msg_type="pkg/msg/Empty"))
    with pytest.raises(CommandFailedError, match="no topic `/new`"):
        topic_to_publish(look, place(), wanted("/new"))


@pytest.mark.parametrize("confirmed", [True, False])
def test_a_launcher_publishes_once_somebody_listens(
    confirmed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = Look(("/b", "pkg/msg/State"), confirmed=confirmed)
    launcher(monkeypatch, look)
    published = publish_by_launcher(place(), wanted())
    assert published == Published(topic="/arm/state", count=1, is_confirmed=confirmed)
    assert look.published == [("/arm/state", "pkg/msg/State", {"count": 1}, 1)]


def test_a_launcher_is_not_asked_to_publish_what_does_not_fit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    look = Look(("/b", "pkg/msg/Other"))
    launcher(monkeypatch, look)
    with pytest.raises(MisuseError, match="count: expected"):
        publish_by_launcher(place(), wanted(message={"count": "a"}))
    with pytest.raises(CommandFailedError, match="/arm/state is of the type pkg/msg/Other"):
        publish_by_launcher(place(), wanted())
    assert look.published == []


def test_a_launcher_is_not_asked_to_move_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    look = Look((ROBOT, "pkg/msg/State"))
    look.looks = 1
    launcher(monkeypatch, look)
    with pytest.raises(CommandFailedError, match=f"/arm/state moves `{ROBOT}`"):
        publish_by_launcher(place(), wanted())
    assert publish_by_launcher(place(), wanted(may_move=True)) is None
    assert look.published == []


def test_the_robots_of_every_stack_here_are_minded_before_they_listen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = node("r", "robot", subscribes=(Endpoint(topic="/arm/state", msg_type=None),))
    plans = {"a": Plan(name="a", processes=()), "b": Plan(name="b", processes=(robot,))}
    monkeypatch.setattr("obk_cli.looking.place.run_plan", lambda folder: plans[folder.name])
    monkeypatch.setattr("obk_cli.looking.place.run_topics", lambda _: {})
    look = Look(("/b", "pkg/msg/State"))
    launcher(monkeypatch, look)
    with pytest.raises(CommandFailedError, match="/arm/state moves `/r`"):
        publish_by_launcher(place("a", "b"), wanted())
    assert publish_by_launcher(place("a", "b"), wanted(may_move=True)) is None
    assert look.published == []
    assert publish_by_launcher(place("a"), wanted()) is not None


def test_what_no_launcher_publishes_is_left_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    launcher(monkeypatch, None)
    assert publish_by_launcher(place(), wanted()) is None
    look = Look(("/b", "pkg/msg/State"), confirmed=None)
    launcher(monkeypatch, look)
    assert publish_by_launcher(place(), wanted("/new", msg_type="other/msg/Kind")) is None
    assert look.published == []
    # It has seen by itself that a robot listens, say.
    assert publish_by_launcher(place(), wanted()) is None
    assert len(look.published) == 1
