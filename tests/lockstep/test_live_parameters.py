"""`Parameter`s in lockstep change between two events, at the same time in every run."""

from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter as RosParameter
from rclpy.task import Future

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.parameter import Parameter

from .world import World

pytestmark = pytest.mark.ros


class Tuned(GuardedLifecycleNode):
    """Records its values at each tick, before and after it sets them itself."""

    kp = Parameter(1.0)
    kd = Parameter(2.0)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.seen: list[tuple[float, ...]] = []
        self.derived = self.kp * self.kd

    def on_parameters(self, changed: frozenset[str]) -> None:
        self.derived = self.kp * self.kd

    def tick(self) -> None:
        self.seen.append((self.kp, self.kd, self.derived))


def test_values_change_between_two_events(world: World) -> None:
    node = world.node(make=Tuned)
    node.create_timer(0.01, node.tick)

    def set_both() -> None:
        node.set_parameters([RosParameter("kp", value=3.0), RosParameter("kd", value=5.0)])
        node.tick()

    world.at(node, 0.015, set_both)
    world.run(0.025)
    assert node.seen == [(1.0, 2.0, 2.0), (1.0, 2.0, 2.0), (3.0, 5.0, 15.0)]


def test_a_request_of_another_node_arrives_between_two_events(world: World) -> None:
    node, other = world.node("tuned", Tuned), world.node("other")
    node.create_timer(0.01, node.tick)
    client = other.create_client(SetParameters, "/tuned/set_parameters")
    sent = [RosParameter(name, value=7.0).to_parameter_msg() for name in ("kp", "kd")]
    answers: list[Any] = []

    def call() -> None:
        future = client.call_async(SetParameters.Request(parameters=sent))
        future.add_done_callback(lambda done: answers.extend(done.result().results))

    world.at(other, 0.015, call)
    world.run(0.025)
    assert node.seen == [(1.0, 2.0, 2.0), (7.0, 7.0, 49.0)]
    assert [answer.reason for answer in answers] == ["in effect", "in effect"]


def test_a_suspended_coroutine_keeps_its_values(world: World) -> None:
    node = world.node(make=Tuned)
    gate = Future()

    async def slow() -> None:
        node.tick()
        await gate
        node.tick()

    timer = node.create_timer(0.01, slow)
    world.run(0.015)
    timer.cancel()
    node.set_parameters([RosParameter("kp", value=3.0)])
    assert node.kp == 1.0
    world.at(node, 0.03, lambda: gate.set_result(None))
    world.run(0.03)
    assert node.seen == [(1.0, 2.0, 2.0)] * 2
    assert (node.kp, node.derived) == (3.0, 6.0)
