"""Subscriptions that take messages past DDS, by context and topic."""

import gc
import weakref
from collections.abc import Callable
from unittest.mock import MagicMock

import pytest
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Int64

from obelisk_py.core.local_delivery import exchange
from obelisk_py.core.local_delivery.exchange import LocalTopic, inbox_of, local_topic


def subscription(
    callback: Callable[..., None] = lambda _message: None,
    qos: QoSProfile | None = None,
    *,
    raw: bool = False,
) -> Subscription:
    """One without a middleware."""
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
    assert local_topic(here, "/a") is local_topic(here, "/a")
    assert local_topic(here, "/a") is not local_topic(here, "/b")
    assert local_topic(here, "/a") is not local_topic(there, "/a")


def test_no_context_is_kept_for_its_topics() -> None:
    context = Context()
    local_topic(context, "/a")
    reference = weakref.ref(context)
    del context
    gc.collect()
    assert reference() is None


def test_every_change_of_a_topic_is_another_tuple() -> None:
    topic, box = LocalTopic(), inbox_of(subscription())
    assert box is not None
    seen = [topic.inboxes]
    topic.open(box)
    seen.append(topic.inboxes)
    topic.close(box)
    seen.append(topic.inboxes)
    topic.open(box)
    seen.append(topic.inboxes)
    assert seen == [(), (box,), (), (box,)]
    assert seen[1] is not seen[3]


def test_a_subscription_keeps_its_inbox_and_an_inbox_no_subscription() -> None:
    heard = subscription()
    box = inbox_of(heard)
    assert box is not None
    assert inbox_of(heard) is box
    reference = weakref.ref(heard)
    del heard
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
def test_what_only_dds_gives_is_taken_from_dds(by_dds: Subscription) -> None:
    assert inbox_of(by_dds) is None


def test_messages_that_cannot_be_copied_are_taken_from_dds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(exchange, "codec_for", lambda _message_class: None)
    assert inbox_of(subscription()) is None
