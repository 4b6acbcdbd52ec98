"""Delivery without DDS: recipients, order, and the switch to DDS."""

import gc
import os
import weakref
from collections.abc import Callable
from typing import Any, Self
from unittest.mock import MagicMock

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, Int64

from obelisk_py.core import intra_process
from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.intra_process import (
    IntraProcessPublisher,
    IntraProcessTopic,
    MessageBuffer,
    buffer_of,
    intra_process_topic,
    is_compatible,
    is_plain,
)
from obelisk_py.core.serialization.codec import codec_for

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Dds:
    """The fake base of rclpy's publisher, which records the sent messages."""

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
    """A publisher, its DDS, and the open buffers."""

    def __init__(self, qos: QoSProfile = RELIABLE, message_class: type[Any] = Int64) -> None:
        self.message_class = message_class
        self.context = Context()
        self.dds = Dds()
        self.topic = intra_process_topic(self.context, "/topic")
        self.publisher = IntraProcessPublisher(
            self.context,
            self.dds,
            message_class,
            "topic",
            qos,
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        self.publisher.on_activate(None)

    def listen(
        self, qos: QoSProfile = RELIABLE, message_class: type[Any] | None = None
    ) -> MessageBuffer:
        """Open a buffer; DDS discovers it immediately."""
        kind = message_class or self.message_class
        codec = codec_for(kind)
        assert codec is not None
        box = MessageBuffer(kind, qos, codec)
        box.mark_dds_empty(box.dds_mark)
        self.topic.open(box)
        self.dds.listeners += 1
        return box


def taken(box: MessageBuffer) -> list[Any]:
    """The waiting messages."""
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


def test_each_subscription_gets_its_own_copy() -> None:
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


def test_without_a_local_subscription_everything_uses_dds() -> None:
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
def test_a_buffer_that_dds_does_not_match_gets_nothing(
    publisher: QoSProfile, qos: QoSProfile, kind: type[Any]
) -> None:
    world = World(publisher)
    box = world.listen(qos, kind)
    # One subscription counts, from outside; the buffer does not.
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []


def test_no_message_overtakes_those_that_dds_still_holds() -> None:
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


def test_no_message_overtakes_those_in_transit_when_a_subscription_was_created() -> None:
    world = World()
    boxes: list[MessageBuffer] = []
    world.dds.on_send = lambda: boxes.append(world.listen())
    world.publisher.publish(Int64(data=1))
    assert boxes[0].dds_may_hold_messages
    world.dds.on_send = lambda: None
    world.publisher.publish(Int64(data=2))
    assert len(world.dds.sent) == 2


def test_a_leaving_and_a_joining_subscription_are_not_confused() -> None:
    world = World()
    box = world.listen()

    def change() -> None:
        world.topic.close(box)  # and the one that DDS counts is outside

    world.dds.on_count = change
    world.publisher.publish(Int64(data=1))
    assert world.dds.sent == [Int64(data=1)]
    assert taken(box) == []


def test_bytes_are_passed_on_too() -> None:
    world = World()
    box = world.listen()
    world.publisher.publish(bytes(serialize_message(Int64(data=5))))
    assert taken(box) == [Int64(data=5)]
    assert not world.dds.sent


def test_messages_of_another_class_are_rejected() -> None:
    world = World()
    box = world.listen()
    with pytest.raises(TypeError, match="Expected"):
        world.publisher.publish("five")
    assert taken(box) == []


def test_a_message_that_cannot_be_copied_is_not_delivered() -> None:
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


def buffer(depth: int = 3) -> MessageBuffer:
    """An empty buffer."""
    codec = codec_for(Int64)
    assert codec is not None
    return MessageBuffer(Int64, QoSProfile(depth=depth), codec)


def numbers(box: MessageBuffer) -> list[int]:
    """Take all waiting messages."""
    taken = []
    while (item := box.take()) is not None:
        taken.append(item[0].data)
    return taken


def test_messages_leave_in_order_of_arrival() -> None:
    box = buffer()
    for number in range(3):
        box.put(Int64(data=number))
    assert numbers(box) == [0, 1, 2]


def test_one_more_than_the_depth_drops_the_oldest() -> None:
    box = buffer(depth=2)
    for number in range(5):
        box.put(Int64(data=number))
    assert numbers(box) == [3, 4]


def test_bytes_are_delivered_as_a_message() -> None:
    codec = codec_for(Int64)
    assert codec is not None
    box = buffer()
    box.put(codec.pack(Int64(data=7)))
    assert numbers(box) == [7]


def test_each_message_signals_unless_another_user_is_to_be_reported() -> None:
    box = buffer()
    box.put(Int64())
    assert os.eventfd_read(box.signal_fd) == 1
    reported: list[None] = []
    box.wake = lambda: reported.append(None)
    box.put(Int64())
    assert reported == [None]
    with pytest.raises(BlockingIOError):
        os.eventfd_read(box.signal_fd)


def test_dds_counts_as_empty_only_up_to_the_mark_before_the_check() -> None:
    box = buffer()
    mark = box.dds_mark
    box.mark_dds_empty(mark)
    assert not box.dds_may_hold_messages
    box.mark_dds()
    assert box.dds_may_hold_messages
    box.mark_dds_empty(mark)
    assert box.dds_may_hold_messages


def test_the_eventfd_is_open_as_long_as_a_publisher_may_write_to_it() -> None:
    box = buffer()
    descriptor, publishers = box.signal_fd, [box]
    del box
    os.eventfd_write(descriptor, 1)
    publishers.clear()
    gc.collect()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.eventfd_write(descriptor, 1)


def subscription(
    callback: Callable[..., None] = lambda _message: None,
    qos: QoSProfile | None = None,
    *,
    raw: bool = False,
) -> Subscription:
    """A publisher without a middleware."""
    handle = MagicMock()
    handle.get_logger_name.return_value = "node"
    return Subscription(
        handle,
        Int64,
        "topic",
        callback,
        MutuallyExclusiveCallbackGroup(),
        qos or QoSProfile(depth=3),
        raw,
        SubscriptionEventCallbacks(use_default_callbacks=False),
    )


def test_a_topic_is_one_of_its_context_and_its_full_name() -> None:
    here, there = Context(), Context()
    assert intra_process_topic(here, "/a") is intra_process_topic(here, "/a")
    assert intra_process_topic(here, "/a") is not intra_process_topic(here, "/b")
    assert intra_process_topic(here, "/a") is not intra_process_topic(there, "/a")


def test_no_context_is_kept_for_its_topics() -> None:
    context = Context()
    intra_process_topic(context, "/a")
    reference = weakref.ref(context)
    del context
    gc.collect()
    assert reference() is None


def test_every_change_of_a_topic_is_another_tuple() -> None:
    topic, box = IntraProcessTopic(), buffer_of(subscription())
    assert box is not None
    seen = [topic.buffers]
    topic.open(box)
    seen.append(topic.buffers)
    topic.close(box)
    seen.append(topic.buffers)
    topic.open(box)
    seen.append(topic.buffers)
    assert seen == [(), (box,), (), (box,)]
    assert seen[1] is not seen[3]


def test_a_subscription_keeps_its_buffer_and_a_buffer_no_subscription() -> None:
    received = subscription()
    box = buffer_of(received)
    assert box is not None
    assert buffer_of(received) is box
    reference = weakref.ref(received)
    del received
    gc.collect()
    assert reference() is None


@pytest.mark.parametrize(
    "by_dds",
    [
        subscription(raw=True),
        subscription(lambda _message, _info: None),
        subscription(qos=QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)),
    ],
    ids=["bytes", "infos", "late joining"],
)
def test_messages_only_from_dds_are_taken_from_dds(by_dds: Subscription) -> None:
    assert buffer_of(by_dds) is None


def test_messages_that_cannot_be_copied_are_taken_from_dds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(intra_process, "codec_for", lambda _message_class: None)
    assert buffer_of(subscription()) is None


@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT, qos_profile_sensor_data])
def test_depth_and_reliability_need_no_dds(qos: QoSProfile) -> None:
    assert is_plain(qos)


@pytest.mark.parametrize(
    "qos",
    [
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        QoSProfile(depth=1, durability=DurabilityPolicy.SYSTEM_DEFAULT),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.SYSTEM_DEFAULT),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_AVAILABLE),
        QoSProfile(depth=1, deadline=Duration(seconds=1)),
        QoSProfile(depth=1, lifespan=Duration(seconds=1)),
        QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1)),
        QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC),
        QoSProfile(depth=1, avoid_ros_namespace_conventions=True),
        QoSProfile(history=HistoryPolicy.KEEP_ALL),
        qos_profile_system_default,
    ],
)
def test_other_settings_of_a_profile_are_left_to_dds(qos: QoSProfile) -> None:
    assert not is_plain(qos)


@pytest.mark.parametrize(
    ("publisher", "subscription", "compatible"),
    [
        (RELIABLE, RELIABLE, True),
        (RELIABLE, BEST_EFFORT, True),
        (BEST_EFFORT, BEST_EFFORT, True),
        (BEST_EFFORT, RELIABLE, False),
    ],
)
def test_a_reliable_subscription_needs_a_reliable_publisher(
    publisher: QoSProfile, subscription: QoSProfile, compatible: bool
) -> None:
    assert is_compatible(publisher, subscription) is compatible
