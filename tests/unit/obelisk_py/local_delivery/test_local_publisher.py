"""When a publisher leaves DDS out: no longer than all who listen have an inbox here."""

from collections.abc import Callable
from typing import Any, Self

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, Int64

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.local_delivery.exchange import local_topic
from obelisk_py.core.local_delivery.inbox import Inbox
from obelisk_py.core.local_delivery.publisher import LocalPublisher
from obelisk_py.core.serialization.codec import codec_for

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Dds:
    """What rclpy's publisher stands on: notes what is sent."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.listeners = 0
        self.on_count: Callable[[], object] = lambda: None
        self.on_send: Callable[[], object] = lambda: None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        pass

    def get_logger_name(self) -> str:
        return "node"

    def get_topic_name(self) -> str:
        return "/topic"

    def get_subscription_count(self) -> int:
        self.on_count()
        return self.listeners

    def publish_raw(self, data: bytes) -> None:
        self.sent.append(deserialize_message(data, Int64))
        self.on_send()

    def destroy_when_not_in_use(self) -> None:
        pass


class World:
    """A publisher, its DDS, and the inboxes that are open."""

    def __init__(self, qos: QoSProfile = RELIABLE, message_class: type[Any] = Int64) -> None:
        self.message_class = message_class
        self.context = Context()
        self.dds = Dds()
        self.topic = local_topic(self.context, "/topic")
        self.publisher = LocalPublisher(
            self.context,
            self.dds,
            message_class,
            "topic",
            qos,
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        self.publisher.on_activate(None)

    def listen(self, qos: QoSProfile = RELIABLE, message_class: type[Any] | None = None) -> Inbox:
        """Open an inbox; DDS knows it at once."""
        kind = message_class or self.message_class
        codec = codec_for(kind)
        assert codec is not None
        box = Inbox(kind, qos, codec)
        box.mark_dds_empty(box.dds_mark)
        self.topic.open(box)
        self.dds.listeners += 1
        return box


def taken(box: Inbox) -> list[Any]:
    """The messages that wait."""
    messages = []
    while (item := box.take()) is not None:
        messages.append(item[0])
    return messages


def test_without_a_listener_outside_nothing_is_sent() -> None:
    world = World()
    one, other = world.listen(), world.listen(BEST_EFFORT)
    world.publisher.publish(Int64(data=1))
    world.publisher.publish(Int64(data=2))
    assert taken(one) == taken(other) == [Int64(data=1), Int64(data=2)]
    assert world.dds.sent == []


def test_each_gets_a_copy_of_its_own() -> None:
    world = World(message_class=Float64MultiArray)
    one, other = world.listen(), world.listen()
    message = Float64MultiArray(data=[1.0])
    world.publisher.publish(message)
    message.data[0] = 2.0
    (got,) = taken(one)
    got.data[0] = 3.0
    assert taken(other) == [Float64MultiArray(data=[1.0])]


def test_with_a_listener_outside_all_get_it_by_dds() -> None:
    world = World()
    box = world.listen()
    world.dds.listeners += 1
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []


def test_with_nobody_here_it_is_for_dds_to_know_who_listens() -> None:
    world = World()
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]


def test_a_publisher_that_is_not_active_is_silent() -> None:
    world = World()
    box = world.listen()
    world.publisher.on_deactivate(None)
    world.publisher.publish(Int64())
    assert not taken(box)
    assert not world.dds.sent


@pytest.mark.parametrize(
    ("publisher", "qos", "kind"),
    [
        (BEST_EFFORT, RELIABLE, Int64),
        (RELIABLE, RELIABLE, Float64MultiArray),
        (QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL), RELIABLE, Int64),
    ],
    ids=["reliability", "type", "late joiners"],
)
def test_an_inbox_that_dds_does_not_match_gets_nothing(
    publisher: QoSProfile, qos: QoSProfile, kind: type[Any]
) -> None:
    world = World(publisher)
    box = world.listen(qos, kind)
    # One listener is counted, from outside; the inbox is not the one.
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []


def test_nothing_overtakes_what_dds_still_holds_for_a_subscription() -> None:
    world = World()
    box = world.listen()
    world.dds.listeners = 2
    world.publisher.publish(Int64(data=1))
    world.dds.listeners = 1
    world.publisher.publish(Int64(data=2))
    assert len(world.dds.sent) == 2
    box.mark_dds_empty(box.dds_mark)
    world.publisher.publish(Int64(data=3))
    assert len(world.dds.sent) == 2
    assert taken(box) == [Int64(data=3)]


def test_nothing_overtakes_what_was_on_its_way_when_a_subscription_came() -> None:
    world = World()
    boxes: list[Inbox] = []
    world.dds.on_send = lambda: boxes.append(world.listen())
    world.publisher.publish(Int64(data=1))
    assert boxes[0].waits_in_dds
    world.dds.on_send = lambda: None
    world.publisher.publish(Int64(data=2))
    assert len(world.dds.sent) == 2


def test_one_who_goes_while_one_comes_is_not_taken_for_the_other() -> None:
    world = World()
    box = world.listen()

    def change() -> None:
        world.topic.close(box)  # and the one that DDS counts is from outside

    world.dds.on_count = change
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []


def test_bytes_are_handed_over_too() -> None:
    world = World()
    box = world.listen()
    world.publisher.publish(bytes(serialize_message(Int64(data=5))))
    assert taken(box) == [Int64(data=5)]
    assert not world.dds.sent


def test_what_is_no_message_of_the_class_is_refused() -> None:
    world = World()
    box = world.listen()
    with pytest.raises(TypeError, match="Expected"):
        world.publisher.publish("five")
    assert taken(box) == []


def test_a_message_that_cannot_be_copied_reaches_nobody() -> None:
    world = World()
    boxes = world.listen(), world.listen()
    bad = Int64()
    bad._data = "five"
    with pytest.raises(ObeliskMsgError, match=r"`data` of std_msgs/msg/Int64 is 'five'"):
        world.publisher.publish(bad)
    assert [taken(box) for box in boxes] == [[], []]


def test_a_publisher_that_is_destroyed_leaves_the_answer_to_rclpy() -> None:
    world = World()
    box = world.listen()
    world.publisher.destroy()
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []
