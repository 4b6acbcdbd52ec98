"""Properties of lockstep runs: random graphs of nodes, and timers compared with those of rcl."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.clock import ROSClock
from rclpy.qos import QoSProfile
from rclpy.time import Time
from rclpy.timer import Timer
from std_msgs.msg import Int64MultiArray

from obelisk_py.core.lockstep.scheduler import NS_PER_S, TimingModel

from ..lockstep.world import World, lockstep_process  # noqa: TID252 - shared by folders of tests

pytestmark = pytest.mark.ros

MS = 1_000_000
DURATION_MS = 200


@pytest.fixture(scope="module", autouse=True)
def _process() -> Iterator[None]:
    with lockstep_process():
        yield


@dataclass(frozen=True, slots=True)
class NodePlan:
    """A node with a timer that publishes, and subscriptions to topics of others."""

    period_ms: int
    compute_ms: int
    depths: tuple[tuple[int, int], ...]
    """Number of a node, and the depth of the subscription to its topic."""


@dataclass(frozen=True, slots=True)
class Callback:
    """A callback that was executed."""

    at_ns: int
    topic: int | None
    """Number of the node that sent the message; None for the timer."""
    sent_ns: int
    number: int


@st.composite
def graphs(draw: st.DrawFn) -> list[NodePlan]:
    """One to four nodes."""
    count = draw(st.integers(1, 4))
    nodes = []
    for _ in range(count):
        topics = draw(st.lists(st.integers(0, count - 1), unique=True, max_size=count))
        depths = tuple((topic, draw(st.integers(1, 4))) for topic in topics)
        nodes.append(NodePlan(draw(st.integers(2, 30)), draw(st.integers(0, 12)), depths))
    return nodes


def _run(graph: list[NodePlan], latency_ms: int, seed: int) -> list[list[Callback]]:
    """The callbacks of each node, in order."""
    world = World(seed=seed, timing=TimingModel(latency=latency_ms / 1000))
    seen: list[list[Callback]] = [[] for _ in graph]
    for number, plan in enumerate(graph):
        node = world.node(f"node_{number}", compute_s=plan.compute_ms / 1000)
        _add_timer(world, node, number, plan, seen[number])
        for topic, depth in plan.depths:
            _add_subscription(world, node, topic, depth, seen[number])
    world.run(DURATION_MS / 1000)
    world.close()
    return seen


def _add_timer(world: World, node: Any, number: int, plan: NodePlan, seen: list[Callback]) -> None:
    publisher = node.create_publisher(Int64MultiArray, f"/topic_{number}", 10)
    ticks: list[int] = []

    def tick() -> None:
        now_ns = world.scheduler.now_ns
        ticks.append(now_ns)
        seen.append(Callback(now_ns, None, now_ns, len(ticks)))
        # Messages published by a callback have the time at which it ends.
        sent_ns = now_ns + plan.compute_ms * MS
        publisher.publish(Int64MultiArray(data=[sent_ns, len(ticks)]))

    node.create_timer(plan.period_ms / 1000, tick)


def _add_subscription(
    world: World, node: Any, topic: int, depth: int, seen: list[Callback]
) -> None:
    def receive(message: Int64MultiArray) -> None:
        sent_ns, number = message.data
        seen.append(Callback(world.scheduler.now_ns, topic, sent_ns, number))

    node.create_subscription(Int64MultiArray, f"/topic_{topic}", receive, QoSProfile(depth=depth))


@given(graph=graphs(), latency_ms=st.integers(0, 5), seed=st.integers(0, 3))
def test_random_graphs(graph: list[NodePlan], latency_ms: int, seed: int) -> None:
    seen = _run(graph, latency_ms, seed)
    assert seen == _run(graph, latency_ms, seed)
    sent = [[call.sent_ns for call in calls if call.topic is None] for calls in seen]
    for number, plan in enumerate(graph):
        calls = seen[number]
        _check_one_at_a_time(calls, plan)
        _check_no_starvation(calls, plan)
        for topic, depth in plan.depths:
            arrivals = [
                at_ns + (graph[topic].compute_ms + latency_ms) * MS for at_ns in sent[topic]
            ]
            received = [call for call in calls if call.topic == topic]
            _check_history(received, arrivals, depth)
            if plan.compute_ms == 0:
                in_time = [at_ns for at_ns in arrivals if at_ns <= DURATION_MS * MS]
                assert [call.at_ns for call in received] == in_time


def _check_one_at_a_time(calls: list[Callback], plan: NodePlan) -> None:
    for one, two in pairwise(calls):
        assert two.at_ns >= one.at_ns + plan.compute_ms * MS
    # Messages are ordered by time, across all topics.
    messages = [call.sent_ns for call in calls if call.topic is not None]
    assert messages == sorted(messages)


def _check_no_starvation(calls: list[Callback], plan: NodePlan) -> None:
    waiting = 2 + sum(depth for _, depth in plan.depths)
    longest_ns = (plan.period_ms + waiting * plan.compute_ms) * MS
    ticks = [0, *(call.at_ns for call in calls if call.topic is None), DURATION_MS * MS]
    assert all(two - one <= longest_ns for one, two in pairwise(ticks))


def _check_history(received: list[Callback], arrivals: list[int], depth: int) -> None:
    numbers = [call.number for call in received]
    assert numbers == sorted(set(numbers))
    for call in received:
        arrived_ns = arrivals[call.number - 1]
        assert call.at_ns >= arrived_ns
        waiting = [at_ns for at_ns in arrivals[call.number :] if at_ns < call.at_ns]
        assert len(waiting) < depth


@given(
    period_ms=st.integers(1, 20),
    looks_ms=st.lists(st.integers(1, 60), min_size=1, max_size=12),
    resets=st.sets(st.integers(0, 11), max_size=2),
    changes=st.dictionaries(st.integers(0, 11), st.integers(1, 20), max_size=2),
)
def test_timers_are_those_of_rcl(
    period_ms: int, looks_ms: list[int], resets: set[int], changes: dict[int, int]
) -> None:
    """A timer that an executor checks only occasionally ticks as rcl's timer would."""
    world = World()
    node = world.node()
    scheduled = world.lockstep.nodes["/node"]
    ticks: list[int] = []
    ours: Any = node.create_timer(period_ms / 1000, lambda: ticks.append(world.scheduler.now_ns))
    clock: Any = ROSClock()
    clock._set_ros_time_is_active(True)
    _set_time(clock, 0)
    theirs: Any = Timer(None, None, period_ms * MS, clock)
    expected: list[int] = []
    now_ns = 0
    for place, look_ms in enumerate(looks_ms):
        now_ns += look_ms * MS
        _set_time(clock, now_ns)
        world.scheduler.freeze(scheduled)
        world.run((now_ns - world.scheduler.now_ns) / NS_PER_S)
        if place in changes:
            ours.timer_period_ns = theirs.timer_period_ns = changes[place] * MS
        if place in resets:
            ours.reset()
            theirs.reset()
        while theirs.is_ready():
            theirs.handle.call_timer()
            expected.append(now_ns)
        world.scheduler.thaw(scheduled)
        world.run(0.0)
        assert ticks == expected
        assert ours.time_until_next_call() == theirs.time_until_next_call()
        assert ours.time_since_last_call() == theirs.time_since_last_call()
    theirs.destroy()
    world.close()


def _set_time(clock: Any, time_ns: int) -> None:
    clock.set_ros_time_override(Time(nanoseconds=time_ns, clock_type=clock.clock_type))
