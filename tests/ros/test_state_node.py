"""Control of lifecycle nodes, and the stack as one of them, by other ROS 2 clients."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.impl.implementation_singleton import rclpy_implementation

from obk_cli.launch.events import (
    Answered,
    ChangeRequested,
    InputEvent,
    Ready,
    StateAnswered,
    StateSeen,
    TransitionStarted,
)
from obk_cli.launch.ros_nodes import RosNodes, open_ros_nodes
from obk_cli.launch.state_node import StateNode
from obk_cli.ros.environment import RosEnvironment, ros_environment
from obk_cli.ros.graph import FOREIGN_DISCOVERY_S, OWN_DISCOVERY_S, RosGraph
from obk_cli.ros.participant import open_participant
from obk_cli.runs.protocol import ChangeAnswer

from .stack import DEADLINE_S, eventually

pytestmark = pytest.mark.ros

NODE = """
import rclpy
from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import String
rclpy.init()
node = LifecycleNode("n")
publisher = node.create_publisher(String, "/control", 10)
rclpy.spin(node)
"""


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> RosEnvironment:
    """The node as in a launch, removed at the end."""
    environment = ros_environment()
    for name, value in environment.variables.items():
        monkeypatch.setenv(name, value)
    return environment


SERVICES: dict[str, Any] = {
    "change_state": ChangeState,
    "get_state": GetState,
    "get_available_states": GetAvailableStates,
    "get_available_transitions": GetAvailableTransitions,
    "get_transition_graph": GetAvailableTransitions,
}


class World:
    """A state node, its requests, and a client in another context."""

    def __init__(self, host: RosNodes, client: RosNodes) -> None:
        self.asked: SimpleQueue[Any] = SimpleQueue()
        self.refused: list[str] = []
        self.node = StateNode(host, "my stack", self.asked.put, self.refused.append)
        self.client = client
        self._clients = {
            service: client._node.create_client(kind, f"/my_stack/{service}")
            for service, kind in SERVICES.items()
        }
        for service, one in self._clients.items():
            assert one.wait_for_service(DEADLINE_S)
            # A response to a client that the node has not discovered yet is lost.
            topic = f"rr/my_stack/{service}Reply"
            known = partial(host._node.get_subscriptions_info_by_topic, topic, no_mangle=True)
            eventually(known, f"the client of {service}, known to the node")

    def call(self, service: str, **fields: Any) -> Any:
        request = SERVICES[service].Request(**fields)
        return self.client._wait(self._clients[service].call_async(request), DEADLINE_S)

    def change(self, **transition: Any) -> bool:
        request = ChangeState.Request()
        for name, value in transition.items():
            setattr(request.transition, name, value)
        return bool(self.call("change_state", transition=request.transition).success)

    def take(self, state: str, answer: ChangeAnswer, **transition: Any) -> tuple[str, bool]:
        """The request that a state leads to, and its response."""
        self.node.show(state)
        asked: list[ChangeRequested] = []

        def reply() -> None:
            asked.append(self.asked.get(timeout=DEADLINE_S))
            asked[0].reply(answer)

        thread = threading.Thread(target=reply)
        thread.start()
        success = self.change(**transition)
        thread.join()
        return asked[0].transition, success


@pytest.fixture
def world(environment: RosEnvironment) -> Iterator[World]:
    with (
        open_ros_nodes("host", environment) as host,
        open_ros_nodes("client", environment) as client,
    ):
        yield World(host, client)


def test_a_change_is_answered_when_complete_and_the_state_in_between(
    world: World,
) -> None:
    world.node.show("inactive")
    seen: list[tuple[str, str, int]] = []
    world.client._node.create_subscription(
        TransitionEvent,
        "/my_stack/transition_event",
        lambda e: seen.append((e.start_state.label, e.goal_state.label, e.transition.id)),
        10,
    )
    eventually(lambda: world.node._events.get_subscription_count(), "the subscription")
    results: SimpleQueue[bool] = SimpleQueue()
    thread = threading.Thread(target=lambda: results.put(world.change(label="activate")))
    thread.start()
    asked = world.asked.get(timeout=DEADLINE_S)
    assert (asked.transition, asked.nodes) == ("activate", ())
    world.node.show("activating")
    assert world.client.state("/my_stack", DEADLINE_S) == "activating"
    assert results.empty()
    world.node.show("active")
    asked.reply(ChangeAnswer(success=True))
    thread.join(DEADLINE_S)
    assert results.get(timeout=DEADLINE_S) is True
    assert world.client.state("/my_stack", DEADLINE_S) == "active"
    eventually(lambda: len(seen) == 2, "both events")
    assert seen == [("inactive", "activating", 3), ("activating", "active", 30)]


def test_transitions_by_number_and_by_label_and_their_errors(world: World) -> None:
    done = ChangeAnswer(success=True)
    assert world.take("unconfigured", done, id=1) == ("configure", True)
    assert world.take("active", done, id=7) == ("shutdown", True)
    assert world.take("inactive", done, label="shutdown") == ("shutdown", True)
    failed = ChangeAnswer(success=False, why="/robot: no model")
    assert world.take("unconfigured", failed, label="configure", id=3) == ("configure", False)
    assert world.client.last_fault("/my_stack", DEADLINE_S) == "/robot: no model"
    for wrong in ({"id": 7}, {"id": 99}, {"label": "activate"}, {"label": "fly"}):
        assert not world.change(**wrong)
    assert world.asked.empty()
    assert world.refused[0] == (
        "the transition `7` is not allowed in the state `unconfigured`; "
        "possible now: configure, shutdown"
    )
    assert len(world.refused) == 4
    assert world.client.last_fault("/my_stack", DEADLINE_S) == world.refused[-1]
    assert world.client.state("/my_stack", DEADLINE_S) == "unconfigured"


def test_possible_transitions_are_reported(world: World) -> None:
    assert world.call("get_state").current_state.label == "unknown"
    world.node.show("inactive")
    assert world.call("get_state").current_state.id == 2
    states = world.call("get_available_states").available_states
    assert {"unknown", "active", "errorprocessing"} < {state.label for state in states}
    here = world.call("get_available_transitions").available_transitions
    assert [(d.transition.id, d.transition.label, d.goal_state.label) for d in here] == [
        (2, "cleanup", "cleaningup"),
        (3, "activate", "activating"),
        (6, "shutdown", "shuttingdown"),
    ]
    graph = world.call("get_transition_graph").available_transitions
    assert len(graph) == 16
    assert "/my_stack" in world.client.find(["/my_stack"], DEADLINE_S, 0.1)


@contextmanager
def running_node() -> Iterator["subprocess.Popen[bytes]"]:
    process = subprocess.Popen([sys.executable, "-c", NODE], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


class Ears:
    """The events received from a node."""

    def __init__(self, ros: RosNodes) -> None:
        self.received: list[InputEvent] = []
        ros.report_to(self.received.append)

    def count(self, what: InputEvent) -> int:
        return self.received.count(what)


class Captured:
    """`sys.stderr` in a terminal application: it has no descriptor."""

    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        pass

    def fileno(self) -> int:
        return -1


def test_nodes_are_asked_from_a_terminal_application(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", Captured())
    with running_node(), open_ros_nodes("client", environment) as ros:
        assert ros.state("/n", DEADLINE_S) == "unconfigured"


def test_nodes_are_asked_with_an_rclpy_that_has_no_events_executor(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(rclpy_implementation, "EventsExecutor")
    with running_node(), open_ros_nodes("client", environment) as ros:
        assert ros.state("/n", DEADLINE_S) == "unconfigured"


def test_a_restarted_node_is_ready_when_its_new_process_replies(
    environment: RosEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready = Ready(node="/n", state="unconfigured")
    monkeypatch.setattr("obk_cli.ros.lifecycle_client.PING_S", 0.0)
    with open_ros_nodes("watch", environment) as ros:
        ears = Ears(ros)
        ros.prepare(["/n"])
        assert ears.received == []
        ros.watch(["/n"])
        with running_node() as first:
            eventually(lambda: ears.count(ready) == 1, "the first process")
            first.kill()
            first.wait()
            # The dead node's services are still in the graph, and requests are not answered.
            for _ in range(30):
                ros.ask_state("/n")
        assert len(ros._clients._client("/n", "get_state")._pending_requests) == 1
        assert ros._clients.is_ready("/n", "change_state")
        ros.watch(["/n"])
        assert ros.state("/n", 0.3) is None
        assert ears.count(ready) == 1
        ros.request("/n", "configure")
        with running_node():
            eventually(lambda: ears.count(ready) == 2, "the second process")
            assert {type(received) for received in ears.received} == {Ready}
            ros.ask_state("/n")
            state = StateAnswered(node="/n", state="unconfigured")
            eventually(lambda: ears.count(state), "its state")
            ros.request("/n", "configure")
            done = Answered(node="/n", transition="configure", success=True, fault="")
            eventually(lambda: ears.count(done), "its answer")
            seen = StateSeen(node="/n", state="inactive", transition="configure")
            eventually(lambda: ears.count(seen), "what it reports")
        assert ears.count(TransitionStarted(node="/n", transition="configure")) == 1
        assert (ears.count(ready), ears.count(state), ears.count(seen)) == (2, 1, 1)


def test_a_others_that_publishes_on_a_control_topic_is_found(
    environment: RosEnvironment,
) -> None:
    with running_node(), open_ros_nodes("probe", environment) as ros:
        topics = ["/control", "/other"]
        eventually(
            lambda: (
                ros.foreign_publishers(topics, [], FOREIGN_DISCOVERY_S) == (("/control", "/n"),)
            ),
            "the other publisher",
        )
        assert ros.foreign_publishers(["/other"], [], OWN_DISCOVERY_S) == ()
        assert ros.foreign_publishers(["/control"], ["/n"], OWN_DISCOVERY_S) == ()


def test_a_node_that_never_appears_is_no_longer_awaited_at_the_end(
    environment: RosEnvironment,
) -> None:
    before = set(threading.enumerate())
    with open_ros_nodes("watch", environment) as ros:
        ears = Ears(ros)
        ros.watch(["/never", "/nor_this"])
        ros.watch(["/never"])
        assert "watch" in {thread.name for thread in set(threading.enumerate()) - before}
    assert set(threading.enumerate()) <= before
    assert ears.received == []


def test_only_the_clients_own_node_stays_in_the_graph(environment: RosEnvironment) -> None:
    with (
        open_ros_nodes("probe", environment) as ros,
        open_participant(environment, name="beside") as beside,
    ):
        own = f"/probe_{os.getpid()}"
        eventually(lambda: beside.nodes() == (own,), "the client's node, and no other")
        eventually(lambda: ros.participant().nodes() == (beside.name,), "no other but its own")


def test_discovery_is_waited_for_since_the_participants_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    empty_node = SimpleNamespace(get_node_names_and_namespaces=list)
    slept: list[float] = []
    monkeypatch.setattr("obk_cli.ros.graph.time", clock_that_sleeps(slept))
    RosGraph(empty_node, begin_s=-OWN_DISCOVERY_S).taken(["/n"], OWN_DISCOVERY_S)
    assert slept == []
    RosGraph(empty_node, begin_s=-0.3).taken(["/n"], OWN_DISCOVERY_S)
    assert sum(slept) == pytest.approx(OWN_DISCOVERY_S - 0.3, abs=0.02)


def clock_that_sleeps(slept: list[float]) -> SimpleNamespace:
    """A clock that starts at 0 s and advances by the slept time [s]."""
    return SimpleNamespace(monotonic=lambda: sum(slept), sleep=slept.append)
