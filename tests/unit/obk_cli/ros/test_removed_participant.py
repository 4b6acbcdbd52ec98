"""How a participant leaves the ROS graph, without ROS."""

import os
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from obk_cli.ros import participant as ros_participant
from obk_cli.ros.participant import RosParticipant, remove_participant


class Node:
    """A node of rclpy that does not exist."""

    def __init__(self, events: list[str]) -> None:
        self._events = events

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def get_node_name(self) -> str:
        return "look"

    def destroy_when_not_in_use(self) -> None:
        self._events.append("node")


def test_a_participant_is_removed_with_all_threads_on_one_core() -> None:
    before = os.sched_getaffinity(0)
    is_over = threading.Event()
    other = threading.Thread(target=is_over.wait)
    other.start()
    seen: list[set[int]] = []

    def remove() -> None:
        seen.extend(os.sched_getaffinity(thread) for thread in (0, other.native_id or 0))
        raise ValueError("failed")

    with pytest.raises(ValueError, match="failed"):
        remove_participant(remove)
    after = os.sched_getaffinity(other.native_id or 0)
    is_over.set()
    other.join()
    assert (seen, after) == ([{min(before)}] * 2, before)
    assert os.sched_getaffinity(0) == before


def test_a_participant_leaves_with_its_subscriptions(monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []

    class Subscription:
        def close(self) -> None:
            events.append("subscription")

    monkeypatch.setattr(ros_participant, "RawSubscription", lambda *_, **__: Subscription())
    functions: Any = SimpleNamespace()
    participant = RosParticipant(Node(events), functions, 0)
    kept = participant.subscribe("/est", "p/msg/M", object)
    participant.close()
    assert kept is not None
    assert events == ["subscription", "node"]
