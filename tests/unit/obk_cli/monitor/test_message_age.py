"""Ages of messages by the stamp at their start."""

import struct

from obk_cli.monitor.model import MessageAge
from obk_cli.monitor.topic_watch import MessageAgeMeter
from obk_cli.ros.simulated_clock import SimulatedClock

S = 1_000_000_000
NOW = 1_800_000_000 * S


def message(stamp_ns: int, *, order: str = "<") -> bytes:
    encapsulation = b"\x00\x01\x00\x00" if order == "<" else b"\x00\x00\x00\x00"
    return encapsulation + struct.pack(f"{order}iI", *divmod(stamp_ns, S)) + b"and the rest"


def test_half_of_the_messages_and_nearly_all_are_at_most_so_old() -> None:
    meter = MessageAgeMeter(2.0)
    for number in range(200):
        meter.take(NOW + number * 1_000_000, message(NOW, order="<>"[number % 2]))
    assert meter.age(NOW) == MessageAge(p50_s=0.1, p99_s=0.198, is_carried=False)


def test_a_stamp_that_was_taken_over_reports_the_age_of_the_chain() -> None:
    up, down, other = (MessageAgeMeter(2.0) for _ in range(3))
    for number in range(10):
        stamp = NOW + number
        up.take(stamp + 1000, message(stamp))
        down.take(stamp + 3000, message(stamp))
        other.take(stamp + 3000, message(stamp + 2000))
    carried, own = down.age(NOW, [up]), other.age(NOW, [up])
    assert carried is not None
    assert carried.is_carried
    assert own is not None
    assert not own.is_carried


def test_unset_stamps_and_those_of_another_clock_give_no_age() -> None:
    meter = MessageAgeMeter(2.0)
    meter.take(NOW, message(0))
    meter.take(NOW, b"\x00\x01\x00\x00")
    assert meter.age(NOW) is None
    meter.take(NOW, message(5 * S))
    assert meter.age(NOW) is None


def test_simulated_stamps_have_an_age_in_simulated_time() -> None:
    clock = SimulatedClock()
    meter = MessageAgeMeter(2.0, clock)
    meter.take(NOW, message(S))  # before `/clock` was received
    assert meter.age(NOW) is None
    for number in range(100):
        time_ns = S + number * 1_000_000
        clock.take(NOW + 2 * number * 1_000_000, message(time_ns))
        meter.take(NOW + 2 * number * 1_000_000 + 500_000, message(time_ns - 3_000_000))
    assert meter.age(NOW) == MessageAge(p50_s=0.003, p99_s=0.003, is_carried=False)


def test_a_silent_topic_has_no_age() -> None:
    meter = MessageAgeMeter(2.0)
    meter.take(NOW + S // 10, message(NOW))
    meter.take(NOW + S, message(NOW + S // 2))
    now = meter.age(NOW + 3 * S)
    assert now is not None
    assert now.p50_s == 0.5
    assert meter.age(NOW + 4 * S) is None


def test_stamps_of_a_slower_topic_are_compared_with_those_still_known() -> None:
    up, down = MessageAgeMeter(2.0), MessageAgeMeter(5.0)
    for number in range(20_000):  # 20 s at 1 kHz, 1 s of which is kept
        stamp = NOW + number * S // 1000
        up.take(stamp, message(stamp))
        if not number % 100:
            down.take(stamp, message(stamp))
    age = down.age(NOW + 20 * S, [up])
    assert age is not None
    assert age.is_carried
