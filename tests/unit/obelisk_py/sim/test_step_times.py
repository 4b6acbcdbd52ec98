"""The due times of steps and outputs, with times set by the test."""

from fractions import Fraction
from math import ceil
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_py.core.sim.mujoco import step_times
from obelisk_py.core.sim.mujoco.step_times import (
    MonotonicClock,
    Pace,
    SampleTimes,
    StepTime,
    whole_steps,
)

MS = 1_000_000
HOUR_S = 3_600
SECONDS = st.builds(Fraction, st.integers(1, 5_000), st.integers(1, 100_000))


def test_an_hour_of_late_wakings_does_not_drift():
    pace = Pace(0.001)
    pace.start(5)
    now_ns = 5
    for step in range(1, 3_600_001):
        deadline_ns = pace.next_deadline_ns(now_ns)
        now_ns = deadline_ns + (step % 7) * 50_000
    assert deadline_ns == 5 + 3_600_000 * MS
    assert pace.overruns == 0


def test_a_fractional_period_in_nanoseconds_does_not_drift():
    pace = Pace(0.001 / 3)
    pace.start(0)
    deadlines = [pace.next_deadline_ns(0) for _ in range(3_000)]
    assert deadlines[2] == MS
    assert deadlines[-1] == 1_000 * MS


def test_a_short_delay_is_caught_up_by_steps_that_are_due_immediately():
    pace = Pace(0.001)
    pace.start(0)
    late = [pace.next_deadline_ns(10 * MS) for _ in range(10)]
    assert late == [step * MS for step in range(1, 11)]
    assert pace.next_deadline_ns(10 * MS) == 11 * MS
    assert pace.overruns == 0


def test_a_long_delay_is_counted_and_restarts_the_schedule():
    pace = Pace(0.001)
    pace.start(0)
    assert pace.next_deadline_ns(501 * MS) == 501 * MS
    assert (pace.overruns, pace.lost_s) == (1, pytest.approx(0.5))
    assert pace.next_deadline_ns(501 * MS) == 502 * MS
    assert pace.overruns == 1


def test_a_restart_forgets_missed_steps():
    pace = Pace(0.001)
    pace.start(0)
    pace.next_deadline_ns(500 * MS)
    pace.start(700 * MS)
    assert pace.next_deadline_ns(700 * MS) == 701 * MS
    assert (pace.overruns, pace.lost_s) == (0, 0.0)


def _sampled(period_s, step_s, steps):
    times = SampleTimes(period_s=period_s, step_s=step_s)
    taken = []
    for step in range(1, steps + 1):
        if step >= times.next_step:
            taken.append(step)
            times.pass_step(step)
    return taken


def test_a_period_of_whole_steps_is_sampled_at_its_multiples():
    assert _sampled(0.002, 0.001, 9) == [2, 4, 6, 8]
    assert _sampled(0.001, 0.001, 3) == [1, 2, 3]


def test_a_period_of_broken_steps_is_rounded_up_to_steps_and_keeps_its_mean_rate():
    assert _sampled(0.0025, 0.001, 10) == [3, 5, 8, 10]
    assert len(_sampled(1 / 300, 0.001, 100_000)) == 30_000


def test_a_period_shorter_than_the_step_is_sampled_at_every_step():
    assert _sampled(0.0004, 0.002, 5) == [1, 2, 3, 4, 5]
    assert _sampled(1e-12, 0.002, 5) == [1, 2, 3, 4, 5]


def test_the_number_of_samples_is_exact_over_ten_million_steps():
    times = SampleTimes(period_s=0.003, step_s=0.001)
    times.pass_step(9_999_999)
    assert times.next_step == 10_000_002


def test_steps_that_were_taken_together_are_sampled_once():
    times = SampleTimes(period_s=0.002, step_s=0.001)
    times.pass_step(7)
    assert times.next_step == 8


@pytest.mark.parametrize(
    ("step", "period"),
    [
        (Fraction(1, 1_000), Fraction(1, 10)),
        (Fraction(1, 1_000), Fraction(1, 30)),
        (Fraction(1, 240), Fraction(1, 20)),
        (Fraction(1, 3_000), Fraction(7, 200)),
    ],
)
def test_in_an_hour_no_sample_is_missing_and_no_stamp_is_off(step, period):
    times = SampleTimes(period_s=float(period), step_s=float(step))
    step_time = StepTime(float(step))
    last = int(HOUR_S / step)
    count = 0
    while times.next_step <= last:
        count += 1
        times.pass_step(times.next_step)
    assert count == HOUR_S // period
    assert step_time.ns(last) == HOUR_S * 1_000 * MS


@given(step=SECONDS, period=SECONDS, after=st.integers(0, 10**9))
def test_the_next_sample_follows_the_first_step_that_reaches_a_multiple(step, period, after):
    times = SampleTimes(period_s=float(period), step_s=float(step))
    times.pass_step(after)
    passed = after * step // period
    assert times.next_step == max(after + 1, ceil((passed + 1) * period / step))


@given(step=SECONDS, steps=st.integers(0, 10**9))
def test_the_time_of_a_step_is_exact_to_the_nanosecond(step, steps):
    exact_ns = steps * step * 1_000 * MS
    assert abs(StepTime(float(step)).ns(steps) - exact_ns) <= Fraction(1, 2)


@given(step=SECONDS, duration=SECONDS)
def test_a_duration_is_rounded_up_to_steps(step, duration):
    assert whole_steps(float(duration), float(step)) == ceil(duration / step)


def test_the_clock_does_not_wait_for_a_time_that_has_passed():
    clock = MonotonicClock()
    before_ns = clock.now_ns()
    assert clock.sleep_until_ns(before_ns - 1, lambda: False) >= before_ns


def test_the_clock_does_not_wait_once_it_is_stopped():
    clock = MonotonicClock()
    far_ns = clock.now_ns() + 3_600_000 * MS
    assert clock.sleep_until_ns(far_ns, lambda: True) < far_ns


def test_the_clock_sleeps_in_parts_and_can_be_stopped_after_each(monkeypatch):
    now_ns, slept_s = 0, []

    def sleep(seconds):
        nonlocal now_ns
        slept_s.append(seconds)
        now_ns += round(seconds * 1_000 * MS)

    fake = SimpleNamespace(monotonic_ns=lambda: now_ns, sleep=sleep)
    monkeypatch.setattr(step_times, "time", fake)
    assert MonotonicClock().sleep_until_ns(120 * MS, lambda: False) == 120 * MS
    assert slept_s == pytest.approx([0.05, 0.05, 0.02])
    assert MonotonicClock().sleep_until_ns(500 * MS, lambda: now_ns > 150 * MS) == 170 * MS
