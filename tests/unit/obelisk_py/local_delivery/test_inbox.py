"""An inbox: a queue of messages with the depth of its subscription."""

import gc
import os

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import Int64

from obelisk_py.core.local_delivery.inbox import Inbox
from obelisk_py.core.serialization.codec import codec_for


def inbox(depth: int = 3) -> Inbox:
    """An empty one."""
    codec = codec_for(Int64)
    assert codec is not None
    return Inbox(Int64, QoSProfile(depth=depth), codec)


def numbers(box: Inbox) -> list[int]:
    """All that waits, taken."""
    taken = []
    while (item := box.take()) is not None:
        taken.append(item[0].data)
    return taken


def test_messages_come_out_in_the_order_in_which_they_came_in() -> None:
    box = inbox()
    for number in range(3):
        box.put(Int64(data=number))
    assert numbers(box) == [0, 1, 2]


def test_one_more_than_the_depth_drops_the_oldest() -> None:
    box = inbox(depth=2)
    for number in range(5):
        box.put(Int64(data=number))
    assert numbers(box) == [3, 4]


def test_bytes_come_out_as_a_message() -> None:
    codec = codec_for(Int64)
    assert codec is not None
    box = inbox()
    box.put(codec.pack(Int64(data=7)))
    assert numbers(box) == [7]


def test_each_message_signals_unless_somebody_else_is_to_be_told() -> None:
    box = inbox()
    box.put(Int64())
    assert os.eventfd_read(box.signal_fd) == 1
    told: list[None] = []
    box.wake = lambda: told.append(None)
    box.put(Int64())
    assert told == [None]
    with pytest.raises(BlockingIOError):
        os.eventfd_read(box.signal_fd)


def test_dds_is_empty_only_as_of_the_mark_that_was_there_before_it_was_looked_at() -> None:
    box = inbox()
    mark = box.dds_mark
    box.mark_dds_empty(mark)
    assert not box.waits_in_dds
    box.mark_dds()
    assert box.waits_in_dds
    box.mark_dds_empty(mark)
    assert box.waits_in_dds


def test_the_eventfd_is_open_as_long_as_a_publisher_may_write_to_it() -> None:
    box = inbox()
    descriptor, publishers = box.signal_fd, [box]
    del box
    os.eventfd_write(descriptor, 1)
    publishers.clear()
    gc.collect()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.eventfd_write(descriptor, 1)
