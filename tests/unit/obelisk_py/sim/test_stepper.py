"""The stepping loop, with a clock and a simulation controlled by the test."""

import pytest

from obelisk_py.core.rate_monitor import TickCounter, late_ns_of
from obelisk_py.core.sim.mujoco.step_times import Pace, SampleTimes
from obelisk_py.core.sim.mujoco.stepper import SkippedTime, Stepper, StepReport, TimedOutput

MS = 1_000_000


class _Clock:
    """Advances only when a caller waits, or when a step takes time."""

    def __init__(self):
        self.ns = 0
        self.waits = []

    def now_ns(self):
        return self.ns

    def sleep_until_ns(self, deadline_ns, stopped):
        self.waits.append(max(0, deadline_ns - self.ns))
        self.ns = max(self.ns, deadline_ns)
        return self.ns


class _Simulation:
    step_s = 0.001

    def __init__(self, clock, cost_ns, step_cost_ns):
        self.steps = 0
        self.counts = []
        self._clock = clock
        self._cost_ns = cost_ns
        self._step_cost_ns = step_cost_ns

    def advance(self, count):
        self.steps += count
        self.counts.append(count)
        self._clock.ns += self._cost_ns + count * self._step_cost_ns
        return ("a warning",) if self.steps == 3 else ()


class _Run:
    def __init__(self, *, factor, until, periods_s=(), cost_ns=0, step_cost_ns=0, begin_ns=0):
        self.clock = _Clock()
        self.clock.ns = begin_ns
        self.simulation = _Simulation(self.clock, cost_ns, step_cost_ns)
        self.published = [[] for _ in periods_s]
        self.warnings = []
        self.reports = []
        self.ticks = TickCounter()
        outputs = [
            TimedOutput(times=SampleTimes(period_s=period, step_s=0.001), publish=self._keep(kept))
            for period, kept in zip(periods_s, self.published, strict=True)
        ]
        self.stepper = Stepper(
            self.simulation,
            pace=Pace(0.001 / factor) if factor else None,
            clock=self.clock,
            outputs=outputs,
            stamp=lambda: self.simulation.steps,
            warn=self.warnings.append,
            report=self.reports.append,
            ticks=self.ticks,
        )
        self.until(until)

    def until(self, until):
        self.stepper.run(lambda: until(self))

    def _keep(self, kept):
        return lambda stamp: kept.append((self.simulation.steps, stamp))


def test_a_second_of_wall_time_is_a_second_of_simulation():
    run = _Run(factor=1.0, until=lambda run: run.simulation.steps >= 1_000)
    assert run.clock.ns == 1_000 * MS
    assert set(run.simulation.counts) == {1}


def test_the_schedule_begins_when_the_run_does():
    run = _Run(factor=1.0, until=lambda run: run.simulation.steps >= 10, begin_ns=5_000 * MS)
    assert run.clock.ns == 5_010 * MS
    assert late_ns_of(run.ticks.buckets, (1.0,)) == (0.0,)


def test_a_factor_of_a_tenth_takes_ten_times_as_long():
    run = _Run(factor=0.1, until=lambda run: run.simulation.steps >= 100)
    assert run.clock.ns == 1_000 * MS


def test_a_factor_of_zero_never_waits():
    run = _Run(factor=0.0, until=lambda run: run.simulation.steps >= 1_000)
    assert run.clock.waits == []
    assert max(run.simulation.counts) == 32


def test_a_factor_of_zero_takes_costly_steps_one_by_one():
    run = _Run(factor=0.0, until=lambda run: run.simulation.steps >= 100, cost_ns=MS)
    assert set(run.simulation.counts[3:]) == {1}


def test_a_factor_of_zero_checks_for_controls_ten_thousand_times_a_second():
    run = _Run(factor=0.0, until=lambda run: run.simulation.steps >= 1_000, step_cost_ns=10_000)
    assert max(run.simulation.counts[1:]) == 10


def test_samples_follow_their_steps_and_carry_the_stamp_of_the_step():
    run = _Run(
        factor=1.0, until=lambda run: run.simulation.steps >= 6, periods_s=(0.001, 0.002, 0.005)
    )
    every, second, fifth = run.published
    assert every == [(step, step) for step in range(1, 7)]
    assert second == [(2, 2), (4, 4), (6, 6)]
    assert fifth == [(5, 5)]


def test_as_fast_as_possible_no_sample_is_missed_or_moved():
    run = _Run(factor=0.0, until=lambda run: run.simulation.steps >= 100, periods_s=(0.007, 0.010))
    sevens, tens = run.published
    assert [step for step, _ in sevens] == list(range(7, 100, 7))
    assert [step for step, _ in tens] == list(range(10, 101, 10))


def test_every_second_is_reported_with_the_measured_factor():
    run = _Run(factor=0.5, until=lambda run: run.clock.ns >= 3_500 * MS)
    assert [report.realtime_factor for report in run.reports] == pytest.approx([0.5] * 3, rel=2e-3)
    assert {report.overruns for report in run.reports} == {0}


def test_a_second_run_is_measured_from_its_own_start():
    run = _Run(factor=1.0, until=lambda run: run.clock.ns >= 10_500 * MS)
    run.reports.clear()
    run.until(lambda run: run.clock.ns >= 12_000 * MS)
    assert [report.realtime_factor for report in run.reports] == pytest.approx([1.0], rel=2e-3)


def test_paced_steps_are_counted_with_their_lateness():
    run = _Run(factor=1.0, until=lambda run: run.simulation.steps >= 1_000)
    assert (run.ticks.ticks, late_ns_of(run.ticks.buckets, (1.0,))) == (1_000, (0.0,))
    late = _Run(factor=1.0, until=lambda run: run.simulation.steps >= 10, cost_ns=3 * MS)
    (longest_ns,) = late_ns_of(late.ticks.buckets, (1.0,))
    assert 18 * MS <= longest_ns <= 18 * MS * 17 / 16


def test_steps_without_a_pace_are_not_counted():
    run = _Run(factor=0.0, until=lambda run: run.simulation.steps >= 100)
    assert run.ticks.ticks == 0


def test_a_machine_that_is_too_slow_is_reported_and_does_not_race():
    run = _Run(factor=1.0, until=lambda run: run.clock.ns >= 5_000 * MS, cost_ns=2 * MS)
    report = run.reports[-1]
    assert report.realtime_factor == pytest.approx(0.5, rel=0.02)
    # Each skips 50 ms, which are lost within 100 ms; only in this second.
    assert report.overruns == pytest.approx(10, abs=1)
    assert report.lost_s == pytest.approx(0.5, rel=0.1)


def test_warnings_of_a_step_are_forwarded():
    run = _Run(factor=1.0, until=lambda run: run.simulation.steps >= 10)
    assert run.warnings == ["a warning"]


def test_no_step_is_taken_once_it_is_stopped_while_it_waits():
    asked = iter([False, True, True])
    run = _Run(factor=1.0, until=lambda _: next(asked))
    assert run.simulation.steps == 0


def test_an_exception_in_a_step_ends_the_run():
    def stop_or_raise(run):
        if run.simulation.steps == 2:
            raise RuntimeError("the step failed")
        return False

    with pytest.raises(RuntimeError, match="the step failed"):
        _Run(factor=1.0, until=stop_or_raise)


def test_skipped_steps_are_warned_of_at_once_and_then_summed_up_over_ten_seconds() -> None:
    def second(overruns: int) -> StepReport:
        return StepReport(realtime_factor=0.5, overruns=overruns, lost_s=overruns / 10)

    skipped = SkippedTime()
    warnings = [skipped.add(second(n)) for n in (0, 1, *[2] * 10, *[0] * 10, 3)]
    assert [n for n, warning in enumerate(warnings) if warning] == [1, 11, 22]
    assert "skipped 0.100 s in the last second (1 time)" in str(warnings[1])
    assert "skipped 2.000 s in the last 10 s (20 times)" in str(warnings[11])
    assert "skipped 0.300 s in the last second (3 times)" in str(warnings[22])
