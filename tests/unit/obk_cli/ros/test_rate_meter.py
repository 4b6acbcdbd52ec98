"""Counting the messages of topics, without ROS, on fake messages."""

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from obk_cli.ros.meters import RosMeter

S = 1_000_000_000


class Topic:
    """A topic with waiting messages, each with its times of publication and reception [ns]."""

    publishers = 1

    def __init__(self) -> None:
        self.waiting: list[tuple[int, int]] = []

    def take(self) -> Iterator[tuple[bytes, Mapping[str, int]]]:
        for number, (published_ns, received_ns) in enumerate(self.waiting, 1):
            yield (
                b"1234",
                {
                    "source_timestamp": published_ns,
                    "received_timestamp": received_ns,
                    "publication_sequence_number": number,
                },
            )
        self.waiting = []


class Look:
    """A participant with a subscription to one topic."""

    def __init__(self) -> None:
        self.topic = Topic()

    def subscribe(self, *_: object, is_light: bool) -> Topic:
        assert not is_light
        return self.topic


@pytest.fixture
def look(monkeypatch: pytest.MonkeyPatch) -> Look:
    monkeypatch.setattr("obk_cli.ros.meters.time.time_ns", lambda: 100 * S)
    return Look()


def counted(look: Any, *waiting: tuple[int, int]) -> int:
    meter = RosMeter(look, 10.0, turn_s=0.0)
    meter.add("/imu", "p/msg/M", object)
    look.topic.waiting = list(waiting)
    meter.turn()
    return meter.rates()["/imu"].count


def test_a_rate_in_simulated_time_is_that_of_its_clock(look: Any) -> None:
    begin = 100 * S

    def half_as_fast(time_ns: int) -> int | None:
        return (time_ns - begin) // 2 if time_ns > begin else None

    meter = RosMeter(look, 10.0, turn_s=0.0)
    meter.add("/imu", "p/msg/M", object, clock=half_as_fast)
    assert meter.rates()["/imu"].rate_hz is None
    look.topic.waiting = [(begin + n * S // 10, begin + n * S // 10) for n in range(20)]
    meter.turn()
    rate = meter.rates()["/imu"]
    assert rate.seen == 19  # the first message arrived before the clock was known
    assert rate.rate_hz == pytest.approx(20.0)


def test_messages_from_before_the_subscription_do_not_count(look: Look) -> None:
    old = [(99 * S + n, 100 * S + n) for n in range(10)]
    new = [(100 * S + n, 100 * S + n) for n in range(10, 13)]
    assert counted(look, *old) == 0
    assert counted(look, *old, *new) == 3


def test_messages_during_a_pause_are_counted(look: Any) -> None:
    meter = RosMeter(look, 10.0, turn_s=0.0)
    meter.add("/imu", "p/msg/M", object)
    meter.turn()
    look.topic.waiting = [(100 * S, 100 * S)]
    assert meter.rates()["/imu"].age_s == 0.0


def test_a_publisher_with_a_late_clock_is_still_counted(look: Look) -> None:
    behind = [(n * S // 10, 100 * S + n * S // 10) for n in range(20)]
    assert counted(look, *behind) == 14
