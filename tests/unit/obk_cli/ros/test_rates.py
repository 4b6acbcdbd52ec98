"""Rates, losses, bandwidth and delays, from made-up times."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.cli.topic_rates import delay_text, rate_text
from obk_cli.ros.meters import MOST_KEPT, DelayMeter, Meter, TopicRate

MS = 1_000_000
BEGIN = 1_700_000_000 * 1_000 * MS


def metered(times_ms: list[float], *, window_s: float = 10.0, size: int = 50) -> Meter:
    meter = Meter(window_s)
    meter.publishers = 1
    for number, time_ms in enumerate(times_ms, 1):
        meter.take(BEGIN + round(time_ms * MS), size, number)
    return meter


def rate_at(meter: Meter, time_ms: float) -> TopicRate:
    return meter.rate(BEGIN + round(time_ms * MS))


def test_a_steady_topic_has_its_rate_and_no_jitter() -> None:
    rate = rate_at(metered([float(ms) for ms in range(1001)]), 1002.0)
    assert (rate.count, rate.seen, rate.lost) == (1001, 1001, 0)
    assert rate.window_s == pytest.approx(1.0)
    assert rate.rate_hz == pytest.approx(1000.0)
    assert rate.min_s == pytest.approx(1e-3)
    assert rate.max_s == pytest.approx(1e-3)
    assert rate.std_dev_s == pytest.approx(0.0, abs=1e-12)
    assert rate.jitter_s == pytest.approx(0.0, abs=1e-12)
    assert rate.bytes_per_s == pytest.approx(50_000)
    assert rate.mean_bytes == pytest.approx(50)
    assert rate.age_s == pytest.approx(2e-3)


def test_uneven_times_are_reported_by_their_spread() -> None:
    rate = rate_at(metered([0, 1, 4]), 4)
    assert rate.rate_hz == pytest.approx(500)
    assert rate.min_s == pytest.approx(1e-3)
    assert rate.max_s == pytest.approx(3e-3)
    assert rate.std_dev_s == pytest.approx(1e-3)
    assert rate.jitter_s == pytest.approx(1e-3)


def test_one_late_message_in_a_thousand_is_no_jitter() -> None:
    times = [float(ms) for ms in range(1000)]
    rate = rate_at(metered([*times, 1020.0]), 1020)
    assert rate.max_s == pytest.approx(21e-3)
    assert rate.jitter_s is not None
    assert rate.jitter_s < 1e-4


def test_only_the_window_counts_for_figures_and_everything_for_the_count() -> None:
    times = [*(ms * 10.0 for ms in range(100)), *(1000.0 + ms for ms in range(1001))]
    rate = rate_at(metered(times, window_s=1.0), 2000.0)
    assert rate.count == 1101
    assert rate.rate_hz == pytest.approx(1000.0)


def test_a_topic_that_fell_silent_has_an_age_and_no_rate() -> None:
    rate = rate_at(metered([0.0, 1.0], window_s=1.0), 5000.0)
    assert rate.rate_hz is None
    assert rate.age_s == pytest.approx(4.999)
    assert rate.count == 2


def test_nothing_came() -> None:
    assert rate_at(Meter(1.0), 0) == TopicRate(count=0, lost=0, seen=0, window_s=0.0)


def test_simultaneous_messages_have_no_rate() -> None:
    assert rate_at(metered([3.0, 3.0]), 4.0).rate_hz is None


def test_gaps_in_the_numbers_of_one_publisher_are_losses() -> None:
    meter = Meter(1.0)
    meter.publishers = 1
    for number in (1, 2, 5):
        meter.take(BEGIN + number * MS, 8, number)
    rate = meter.rate(BEGIN + 9 * MS)
    assert (rate.lost, rate.seen) == (2, 3)
    assert rate.rate_hz == pytest.approx(1000.0)
    assert rate.bytes_per_s == pytest.approx(4_000.0)
    meter.publishers = 2
    assert meter.rate(BEGIN + 9 * MS).lost is None


def test_a_loss_before_the_window_does_not_count_as_published_in_it() -> None:
    meter = Meter(0.0025)
    meter.publishers = 1
    for time_ms, number in ((0, 1), (1, 5), (2, 6), (3, 7)):
        meter.take(BEGIN + time_ms * MS, 8, number)
    rate = meter.rate(BEGIN + 3 * MS)
    assert (rate.lost, rate.seen) == (3, 3)
    assert rate.rate_hz == pytest.approx(1000.0)


def test_memory_is_bounded() -> None:
    meter = Meter(1e6)
    for number in range(MOST_KEPT + 10):
        meter.take(BEGIN + number, 1, number + 1)
    assert meter.rate(BEGIN + MOST_KEPT).seen == MOST_KEPT
    assert meter.count == MOST_KEPT + 10


@given(st.lists(st.integers(0, 10**12), min_size=2, max_size=50))
def test_figures_agree_with_one_another(times: list[int]) -> None:
    meter = Meter(1e6)
    for number, time in enumerate(sorted(times), 1):
        meter.take(BEGIN + time, 10, number)
    rate = meter.rate(BEGIN + 10**12)
    if rate.rate_hz is None:
        assert len(set(times)) == 1
        return
    assert rate.min_s is not None
    assert rate.max_s is not None
    assert rate.std_dev_s is not None
    mean = 1 / rate.rate_hz
    assert rate.min_s <= mean * (1 + 1e-9)
    assert mean <= rate.max_s * (1 + 1e-9)
    assert rate.std_dev_s <= rate.max_s + 1e-12
    assert math.isclose(rate.window_s, mean * (len(times) - 1))


def test_delays_are_from_stamp_to_receipt() -> None:
    meter = DelayMeter(10)
    for delay_ms in (1, 2, 3):
        meter.take(BEGIN + delay_ms * MS, BEGIN)
    delay = meter.delay()
    assert delay is not None
    assert not delay.is_relative
    assert (delay.seen, delay.min_s, delay.mean_s, delay.max_s) == pytest.approx(
        (3, 1e-3, 2e-3, 3e-3)
    )
    assert delay.std_dev_s == pytest.approx(math.sqrt(2 / 3) * 1e-3)


def test_stamps_of_a_simulators_clock_give_only_differences() -> None:
    meter = DelayMeter(10)
    for delay_ms in (5, 7):
        meter.take(BEGIN + delay_ms * MS, 3_000 * MS)
    delay = meter.delay()
    assert delay is not None
    assert delay.is_relative
    assert (delay.min_s, delay.max_s) == pytest.approx((0.0, 2e-3))


@pytest.mark.parametrize("pace", [0.5, 3.0])
def test_a_simulators_clock_that_is_slow_or_fast_makes_no_delays(pace: float) -> None:
    meter = DelayMeter(100)
    for number in range(100):
        late_ms = 4 if number == 50 else 1
        meter.take(BEGIN + (20 * number + late_ms) * MS, round((1000 + 20 * number * pace) * MS))
    delay = meter.delay()
    assert delay is not None
    assert delay.pace == pytest.approx(pace)
    assert (delay.min_s, delay.max_s) == pytest.approx((0.0, 3e-3))
    assert f"the stamps come from another clock, {pace:g} times as fast" in delay_text(delay)


def test_stamps_of_simulated_time_have_delays_in_it() -> None:
    meter = DelayMeter(10)
    meter.take(BEGIN, 1_000 * MS)  # before `/clock` was received
    for number in (1, 2, 3):
        simulated = (1_000 + 10 * number) * MS
        meter.take(BEGIN + 20 * number * MS, simulated - number * MS, simulated)
    meter.take(BEGIN + 80 * MS, 1_041 * MS, 1_040 * MS)
    delay = meter.delay()
    assert delay is not None
    assert delay.is_simulated
    assert not delay.is_relative
    assert (delay.seen, delay.min_s, delay.max_s) == pytest.approx((4, 0.0, 3e-3))
    assert "in simulated time, 0.51" in delay_text(delay)


def test_delays_forget_values_outside_the_window() -> None:
    meter = DelayMeter(1)
    meter.take(BEGIN + 9 * MS, BEGIN)
    meter.take(BEGIN + 1 * MS, BEGIN)
    delay = meter.delay()
    assert delay is not None
    assert delay.max_s == pytest.approx(1e-3)


def test_messages_that_were_never_stamped_are_counted_apart() -> None:
    meter = DelayMeter(1)
    meter.take(BEGIN, 0)
    assert meter.delay() is None
    assert meter.unstamped == 1


def test_a_publisher_that_fell_silent_is_reported_as_silent() -> None:
    steady = metered([100.0 * number for number in range(50)])
    assert "none for" not in rate_text(rate_at(steady, 5_000))
    assert rate_text(rate_at(steady, 8_000)).endswith("  no message for 3.1 s")
    assert rate_text(rate_at(steady, 65_000)) == "no message for 60.1 s"
    assert rate_text(rate_at(metered([0.0]), 65_000)) == "one message"
    assert rate_text(rate_at(Meter(1.0), 0)) == "no message yet"


def test_a_slow_topic_is_not_silent_between_two_messages() -> None:
    slow = metered([0.0, 4_000.0, 8_000.0], window_s=60.0)
    assert "none for" not in rate_text(rate_at(slow, 15_900))
    assert rate_text(rate_at(slow, 16_100)).endswith("  no message for 8.1 s")
