"""A launcher that reports the ROS graph, with a function instead of its node."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from obelisk_spec.parameter_notes import ParameterNotes
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import GraphService, LauncherGraph, ask_launcher
from obk_cli.launch.control_server import serve_control
from obk_cli.ros.graph import GraphSnapshot, TopicInfo
from obk_cli.ros.parameters import NodeParameter, SetAnswer

WAIT_S = 20.0
TYPES = {"/q": ("p/msg/M",)}
SERVICES = {"/arm/get_state": ("p/srv/S",)}


class Node:
    """The launcher's graph, with one more node at each request."""

    name = "/obk_launch_1"

    def __init__(self) -> None:
        self.asked = 0

    def nodes(self) -> tuple[str, ...]:
        self.asked += 1
        return tuple(f"/n{number}" for number in range(self.asked))

    def topics_of(self, node: str) -> tuple[Mapping[str, tuple[str, ...]], ...]:
        return (TYPES, {}) if node == "/n0" else ({}, {})

    def services_of(self, node: str) -> Mapping[str, tuple[str, ...]]:
        return SERVICES if node == "/n0" else {}

    def graph(self) -> GraphSnapshot:
        topics = (TopicInfo(name="/q", msg_types=("p/msg/M",)),)
        names = tuple(f"/n{number}" for number in range(self.asked))
        return GraphSnapshot(nodes=names, topics=topics, services=SERVICES)


@contextmanager
def launcher(
    folder: Path, answer: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
) -> Iterator[LauncherGraph]:
    """The graph of a launcher with such a node; `answer` handles later requests."""
    service = GraphService(Node())  # type: ignore[arg-type]

    def look(question: bytes, reply: Callable[[bytes], None]) -> None:
        data = json.loads(question)
        if answer is None or data == {"about": "graph"}:
            service.ask(question, reply)
        else:
            reply(json.dumps(answer(data)).encode())

    with serve_control(folder, lambda _: None, look):
        found = ask_launcher([folder])
        assert found is not None
        yield found


def test_a_launcher_reports_of_the_graph(tmp_path: Path) -> None:
    with launcher(tmp_path) as look:
        assert look.nodes() == ("/n0",)
        assert look.topic_types() == TYPES
        assert look.topic("/q").msg_types == ("p/msg/M",)
        assert look.service_types() == SERVICES
        assert look.topics_of("/n0") == (TYPES, {})
        assert look.services_of("/n0") == SERVICES
        assert look.services_of("/gone") == {}


def test_undiscovered_names_are_requested_again(tmp_path: Path) -> None:
    with launcher(tmp_path) as look:
        assert look.settle(("/n2",), 0.0, WAIT_S)
        assert "/n2" in look.nodes()
        assert not look.settle(("/never",), 0.0, 0.01)


def test_parameters_are_requested_through_the_launcher(tmp_path: Path) -> None:
    received: list[Mapping[str, Any]] = []

    def answer(question: Mapping[str, Any]) -> Mapping[str, Any]:
        received.append(question)
        value = {"kind": "double", "value": 1.5}
        described = {"name": "gain", "kind": "double", "unit": "m", "least": 0, "is_live": True}
        return {
            "names": ["gain"],
            "values": [value],
            "descriptions": [described],
            "successful": False,
            "reason": "too much",
        }

    with launcher(tmp_path, answer) as look:
        parameters = look.parameters("/arm", WAIT_S)
        gain = NodeParameter(kind="double", value=1.5)
        assert parameters.names() == ("gain",)
        assert parameters.values(["gain"]) == {"gain": gain}
        (description,) = parameters.describe(["gain"]).values()
        assert description.kind == "double"
        assert description.notes == ParameterNotes(unit="m", least=0.0, is_live=True)
        assert parameters.set("gain", gain) == SetAnswer(successful=False, reason="too much")
    assert received[-1] == {
        "about": "parameters",
        "node": "/arm",
        "timeout_s": WAIT_S,
        "do": "set",
        "name": "gain",
        "parameter": {"kind": "double", "value": 1.5},
    }


def test_a_missing_response_of_a_node_is_reported_with_the_launchers_message(
    tmp_path: Path,
) -> None:
    with launcher(tmp_path, lambda _: {"failed": "/arm did not answer", "help": "look"}) as look:
        with pytest.raises(CommandFailedError, match="/arm did not answer") as failed:
            look.parameters("/arm", WAIT_S).names()
        assert failed.value.help == "look"


@pytest.mark.parametrize(
    "question",
    [
        b"",
        b"{}",
        b'{"about": "weather"}',
        b'{"about": "parameters", "node": "/a", "timeout_s": 1}',
        b'{"about": "parameters", "node": "/a", "timeout_s": -1, "do": "names"}',
        b'{"about": "parameters", "node": "/a", "timeout_s": 1, "do": "set", "name": "a"}',
    ],
)
def test_an_invalid_request_is_answered_by_a_failure(question: bytes) -> None:
    replies: list[bytes] = []
    service = GraphService(Node())  # type: ignore[arg-type]
    service.ask(question, replies.append).join(WAIT_S)
    (reply,) = map(json.loads, replies)
    assert reply["failed"].startswith("invalid request: ")


def test_a_launcher_that_does_not_reply_is_skipped(tmp_path: Path) -> None:
    assert ask_launcher([tmp_path]) is None
    with serve_control(tmp_path, lambda _: None):
        assert ask_launcher([tmp_path]) is None


@pytest.mark.parametrize("reported", [None, 5, "x", ["x"], {"x": {"y": 1}}])
def test_any_reply_of_a_launcher_raises_nothing_else(reported: object, tmp_path: Path) -> None:
    keys = ("names", "values", "descriptions")
    asked: tuple[Callable[[LauncherGraph], object], ...] = (
        lambda look: look.parameters("/n0", WAIT_S).names(),
        lambda look: look.parameters("/n0", WAIT_S).values(("a", "b")),
        lambda look: look.parameters("/n0", WAIT_S).describe(("a",)),
    )
    with launcher(tmp_path, lambda _: dict.fromkeys(keys, reported)) as look:
        for ask in asked:
            with suppress(CommandFailedError):  # matching replies are used
                ask(look)


def test_an_incomplete_reply_is_reported(tmp_path: Path) -> None:
    with (
        launcher(tmp_path, lambda _: {"values": []}) as look,
        pytest.raises(CommandFailedError, match="0 values"),
    ):
        look.parameters("/n0", WAIT_S).values(("gain",))
