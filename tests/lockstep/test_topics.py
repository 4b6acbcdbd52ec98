"""Topics in lockstep: order, history, durability, QoS, raw bytes and message infos."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rclpy._rclpy_pybind11 import RCLError
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
)
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64, String

from obelisk_py.core.lockstep.scheduler import LockstepError, TimingModel

from .world import World, seconds

pytestmark = pytest.mark.ros

LATCHED = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_simultaneous_messages_arrive_in_order_of_publication(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[str] = []
    first = sender.create_publisher(String, "/first", 10)
    second = sender.create_publisher(String, "/second", 10)
    receiver.create_subscription(String, "/second", lambda m: seen.append(m.data), 10)
    receiver.create_subscription(String, "/first", lambda m: seen.append(m.data), 10)

    def publish() -> None:
        for number in range(3):
            first.publish(String(data=f"first {number}"))
            second.publish(String(data=f"second {number}"))

    world.at(sender, 0.1, publish)
    world.run(0.1)
    assert seen == [f"{name} {number}" for number in range(3) for name in ("first", "second")]


def test_every_subscription_has_its_own_copy(world: World) -> None:
    sender, one, two = world.node("sender"), world.node("one"), world.node("two")
    seen: list[str] = []

    def change(message: String) -> None:
        seen.append(message.data)
        message.data = "changed"

    for node in (one, two):
        node.create_subscription(String, "/text", change, 10)
    message = String(data="as sent")
    publisher = sender.create_publisher(String, "/text", 10)
    world.at(sender, 0.1, lambda: publisher.publish(message))
    world.run(0.2)
    assert seen == ["as sent", "as sent"]
    assert message.data == "as sent"


@pytest.mark.parametrize(("depth", "kept"), [(1, [9.0]), (3, [7.0, 8.0, 9.0])])
def test_a_busy_node_keeps_the_latest_of_its_depth(
    world: World, depth: int, kept: list[float]
) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[float] = []
    publisher = sender.create_publisher(Float64, "/number", 10)
    profile = QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST)
    receiver.create_subscription(Float64, "/number", lambda m: seen.append(m.data), profile)

    def publish() -> None:
        for number in range(10):
            publisher.publish(Float64(data=float(number)))

    world.at(sender, 0.1, publish)
    world.run(0.1)
    assert seen == kept


def test_a_late_subscription_receives_latched_messages(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[tuple[float, str]] = []
    publisher = sender.create_publisher(String, "/latched", LATCHED)
    for number in range(4):
        world.at(
            sender, 0.1 * (number + 1), lambda n=number: publisher.publish(String(data=f"{n}"))
        )
    world.run(0.5)

    def receive(message: String) -> None:
        seen.append((seconds(receiver), message.data))

    receiver.create_subscription(String, "/latched", receive, LATCHED)
    receiver.create_subscription(String, "/latched", lambda m: seen.append((0, m.data)), 10)
    world.run(0.1)
    assert seen == [(0.5, "2"), (0.5, "3")]


def test_profiles_that_do_not_match_pass_nothing_and_are_noted(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[Any] = []
    publisher = sender.create_publisher(String, "/text", qos_profile_sensor_data)
    receiver.create_subscription(String, "/text", seen.append, QoSProfile(depth=1))
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    receiver.create_subscription(String, "/text", lambda m: seen.append(m.data), best_effort)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="x")))
    world.run(0.1)
    assert seen == ["x"]
    assert publisher.get_subscription_count() == 1
    (note,) = world.notes
    assert "/text" in note
    assert "/sender" in note
    assert "/receiver" in note


def test_another_type_on_a_topic_is_an_error_or_a_note(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[Any] = []
    sender.create_publisher(String, "/topic", 1)
    # As in a composed process: a DDS participant has one type per topic.
    with pytest.raises(RCLError):
        receiver.create_subscription(Float64, "/topic", seen.append, 1)
    with world.lockstep.entered():
        world.lockstep.topics.publish("/topic", Float64())
    (note,) = world.notes
    assert "std_msgs/msg/String" in note
    assert "std_msgs/msg/Float64" in note


def test_raw_subscriptions_and_published_bytes(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    raw: list[bytes] = []
    seen: list[str] = []
    receiver.create_subscription(String, "/text", raw.append, 10, raw=True)
    receiver.create_subscription(String, "/text", lambda m: seen.append(m.data), 10)
    publisher = sender.create_publisher(String, "/text", 10)

    def publish() -> None:
        publisher.publish(String(data="message"))

    world.at(sender, 0.1, publish)
    world.at(sender, 0.2, lambda: publisher.publish(raw[0]))
    world.run(0.2)
    assert [deserialize_message(data, String).data for data in raw] == ["message", "message"]
    assert seen == ["message", "message"]


def test_message_infos_have_the_simulated_times(make_world: Callable[..., World]) -> None:
    world = make_world(timing=TimingModel(latency=0.003))
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[Any] = []

    def receive(message: String, info: Any) -> None:
        seen.append((message.data, info["source_timestamp"], info["received_timestamp"]))

    async def wait(message: String, info: Any) -> None:
        receive(message, info)

    receiver.create_subscription(String, "/text", receive, 10)
    receiver.create_subscription(String, "/text", wait, 10)
    publisher = sender.create_publisher(String, "/text", 10)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="x")))
    world.run(0.2)
    assert seen == [("x", 100_000_000, 103_000_000)] * 2


def test_a_message_of_another_type_is_an_error_of_the_publisher(world: World) -> None:
    node = world.node()
    publisher = node.create_publisher(String, "/text", 10)
    world.at(node, 0.1, lambda: publisher.publish(Float64()))
    world.run(0.1)
    assert node.state_label == "unconfigured"
    assert "TypeError" in str(node.last_fault)


def test_a_destroyed_subscription_receives_no_messages_in_transit(
    make_world: Callable[..., World],
) -> None:
    world = make_world(timing=TimingModel(latency=0.01))
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[Any] = []
    publisher = sender.create_publisher(String, "/text", 10)
    subscription = receiver.create_subscription(String, "/text", seen.append, 10)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="x")))
    world.at(receiver, 0.105, lambda: receiver.destroy_subscription(subscription))
    world.run(0.2)
    assert not seen
    assert publisher.get_subscription_count() == 0


@pytest.mark.parametrize("is_frozen", [False, True])
def test_messages_overtake_each_other_and_none_is_lost(world: World, is_frozen: bool) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[float] = []
    publisher = sender.create_publisher(Float64, "/number", 10)
    receiver.create_subscription(Float64, "/number", lambda m: seen.append(m.data), 10)
    delays_ns = iter([50_000_000, 10_000_000, 30_000_000, 0])
    world.lockstep.topics.by_name["/number"].rules.append(lambda _now, _message: next(delays_ns))
    for number in range(4):
        world.at(
            sender,
            0.1 + 0.001 * number,
            lambda n=number: publisher.publish(Float64(data=float(n))),
        )
    if is_frozen:
        world.scheduler.freeze(world.lockstep.nodes["/receiver"])
    world.run(0.2)
    if is_frozen:
        world.scheduler.thaw(world.lockstep.nodes["/receiver"])
    world.run(0.1)
    assert seen == [3.0, 1.0, 2.0, 0.0]


def test_jitter_keeps_the_order_of_a_publisher(make_world: Callable[..., World]) -> None:
    world = make_world(seed=1, timing=TimingModel(latency=0.001, jitter=0.02))
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: dict[float, float] = {}
    publisher = sender.create_publisher(Float64, "/number", 100)
    receiver.create_subscription(
        Float64, "/number", lambda m: seen.update({m.data: seconds(receiver)}), 100
    )
    ticks = itertools.count()
    sender.create_timer(0.002, lambda: publisher.publish(Float64(data=float(next(ticks)))))
    world.run(1.0)
    assert list(seen) == sorted(seen)
    late_s = np.array([at_s - 0.002 * (number + 1) for number, at_s in seen.items()])
    assert late_s.min() >= 0.001
    assert 0.015 < late_s.max() <= 0.021


def test_a_destroyed_publisher_is_removed(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[Any] = []
    publisher = sender.create_publisher(String, "/latched", LATCHED)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="x")))
    world.run(0.1)
    assert sender.destroy_publisher(publisher)
    receiver.create_subscription(String, "/latched", seen.append, LATCHED)
    world.run(0.1)
    assert not seen


def test_a_lifecycle_publisher_is_silent_unless_its_node_is_active(world: World) -> None:
    sender, receiver = world.node("sender"), world.node("receiver")
    seen: list[str] = []
    publisher = sender.create_lifecycle_publisher(String, "/text", 10)
    receiver.create_subscription(String, "/text", lambda m: seen.append(m.data), 10)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="not yet")))
    world.run(0.1)
    publisher.on_activate(None)
    world.at(sender, 0.1, lambda: publisher.publish(String(data="active")))
    world.run(0.1)
    assert seen == ["active"]


def test_quality_of_service_events_are_rejected_by_name(world: World) -> None:
    node = world.node()
    callbacks = SubscriptionEventCallbacks(deadline=lambda _info: None)

    def subscribe() -> None:
        node.create_subscription(String, "/text", print, 10, event_callbacks=callbacks)

    world.at(node, 0.1, subscribe)
    with pytest.raises(LockstepError, match=r"REQUESTED_DEADLINE_MISSED \(.*test_topics\.py:\d+\)"):
        world.run(0.2)


def test_a_lifespan_is_noted(world: World) -> None:
    world.node().create_publisher(
        String, "/text", QoSProfile(depth=1, lifespan=Duration(seconds=1))
    )
    (note,) = world.notes
    assert "/text with a lifespan" in note


def test_nodes_that_answer_each_other_without_end_are_named(world: World) -> None:
    one, two = world.node("one"), world.node("two")
    ping, pong = (
        one.create_publisher(String, "/ping", 10),
        two.create_publisher(String, "/pong", 10),
    )
    two.create_subscription(String, "/ping", pong.publish, 10)
    one.create_subscription(String, "/pong", ping.publish, 10)
    world.at(one, 0.25, lambda: ping.publish(String(data="ball")))
    with pytest.raises(
        LockstepError,
        match=r"0\.250000 s.*/two \(/ping\), /one \(/pong\)|"
        r"0\.250000 s.*/one \(/pong\), /two \(/ping\)",
    ):
        world.run(1.0)
