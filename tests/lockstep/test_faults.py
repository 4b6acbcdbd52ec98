"""Faults of nodes in lockstep, and how the nodes end."""

import sys
from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep.scheduler import LockstepError

from .world import World, seconds

pytestmark = pytest.mark.ros


def test_a_callback_that_raises_takes_only_its_node_down(world: World) -> None:
    node, other = world.node(), world.node("other")
    ticks: list[float] = []

    def fail() -> None:
        raise ValueError("on purpose")

    node.create_timer(0.1, fail)
    other.create_timer(0.1, lambda: ticks.append(seconds(other)))
    world.run(0.5)
    assert node.state_label == "unconfigured"
    assert "ValueError: on purpose" in str(node.last_fault)
    assert "test_faults.py" in str(node.last_fault)
    assert len(ticks) == 5


def _end_by_exit(_node: Any) -> None:
    sys.exit(3)


def _end_by_rclpy(_node: Any) -> None:
    rclpy.shutdown()


def _end_by_context(node: Any) -> None:
    node.context.try_shutdown()


@pytest.mark.parametrize("end", [_end_by_exit, _end_by_rclpy, _end_by_context])
def test_a_node_that_ends_its_process_ends_alone(world: World, end: Callable[[Any], None]) -> None:
    node, other = world.node(), world.node("other")
    ticks: dict[str, list[float]] = {"node": [], "other": []}
    for each in (node, other):
        each.create_timer(0.1, lambda n=each: ticks[n.get_name()].append(seconds(n)))
    world.at(node, 0.25, lambda: end(node))
    world.run(0.5)
    assert ticks == {"node": [0.1, 0.2], "other": [0.1, 0.2, 0.3, 0.4, 0.5]}
    assert rclpy.ok()
    (fault,) = world.lockstep.faults
    assert fault.startswith("/node ended its process")
    assert "0.25" in fault


def test_a_node_shuts_itself_down(world: World) -> None:
    node = world.node()
    world.at(node, 0.1, node.trigger_shutdown)
    world.run(0.2)
    assert node.state_label == "finalized"
    assert node.last_fault is None


def test_a_node_destroys_itself(world: World) -> None:
    node = world.node()
    ticks: list[int] = []
    node.create_timer(0.05, lambda: ticks.append(1))
    world.at(node, 0.12, node.destroy_node)
    world.run(0.5)
    assert len(ticks) == 2


def test_a_node_that_a_callback_makes_takes_part(world: World) -> None:
    maker, other = world.node("maker"), world.node("other")
    seen: list[tuple[float, str]] = []
    made: list[Any] = []

    def make() -> None:
        child = GuardedLifecycleNode("child")
        made.append(child)
        publisher = child.create_publisher(String, "/text", 10)
        child.create_timer(0.1, lambda: publisher.publish(String(data=f"{seconds(child)}")))

    def receive(message: String) -> None:
        seen.append((seconds(other), message.data))

    other.create_subscription(String, "/text", receive, 10)
    world.at(maker, 0.25, make)
    world.run(0.5)
    assert seen == [(0.35, "0.35"), (0.45, "0.45")]
    assert made[0].executor is maker.executor
    assert world.lockstep.nodes["/maker"].node is maker
    world.lockstep.kill(world.lockstep.nodes["/maker"])
    world.run(0.5)
    assert len(seen) == 2


def test_a_plain_node_ends_the_run(world: World) -> None:
    node = world.node()
    world.at(node, 0.1, lambda: Node("helper"))
    with pytest.raises(LockstepError, match=r"plain rclpy node `helper` \(.*test_faults\.py:\d+"):
        world.run(0.2)


def test_a_plain_node_outside_of_a_run_is_as_ever(world: World) -> None:
    world.run(0.1)
    Node("helper").destroy_node()


def test_a_guard_condition_calls_back_once_for_each_trigger(world: World) -> None:
    node = world.node()
    times: list[float] = []
    guard = node.create_guard_condition(lambda: times.append(seconds(node)))
    world.at(node, 0.1, guard.trigger)
    world.at(node, 0.2, guard.trigger)
    world.run(0.3)
    assert times == [0.1, 0.2]
    world.at(node, 0.4, lambda: (guard.trigger(), node.destroy_guard_condition(guard)))
    world.run(0.2)
    assert times == [0.1, 0.2]


def test_a_frozen_node_catches_up_and_a_killed_one_does_not(world: World) -> None:
    node, other = world.node(), world.node("other")
    ticks: list[float] = []
    texts: list[str] = []
    node.create_timer(0.1, lambda: ticks.append(seconds(node)))
    node.create_subscription(String, "/text", lambda m: texts.append(m.data), 2)
    publisher = other.create_publisher(String, "/text", 10)
    for number in range(5):
        world.at(
            other, 0.15 + 0.01 * number, lambda n=number: publisher.publish(String(data=f"{n}"))
        )
    scheduled = world.lockstep.nodes["/node"]
    world.run(0.12)
    world.scheduler.freeze(scheduled)
    world.run(0.23)
    assert ticks == [0.1]
    assert not texts
    world.scheduler.thaw(scheduled)
    world.run(0.1)
    assert ticks == [0.1, 0.35, 0.4]
    assert texts == ["3", "4"]
    world.scheduler.freeze(scheduled)
    world.lockstep.kill(scheduled)
    world.scheduler.thaw(scheduled)
    world.run(0.5)
    assert ticks == [0.1, 0.35, 0.4]


def test_after_an_error_the_test_sees_the_system_again(world: World) -> None:
    node = world.node()
    world.at(node, 0.1, lambda: Node("helper"))
    with pytest.raises(LockstepError):
        world.run(0.2)
    assert world.scheduler.running is None
    assert world.scheduler.offset_ns == 0
