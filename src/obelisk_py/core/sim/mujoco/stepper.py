"""Step a simulation at its pace, and publish the outputs that are due.

The inputs are a simulation, a pace, and outputs with their sample times. The thread that runs the
loop calls the outputs, and a report once per second of wall time. This module does not use ROS and
starts no threads.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from obelisk_py.core.rate_monitor import TickCounter
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, Clock, Pace
from obelisk_spec.suggestions import with_number

__all__ = ["SkippedTime", "StepReport", "Stepper", "TimeOutput", "TimedOutput", "Times"]

WARNING_S: Final = 10
"""Time between two warnings about skipped steps [s]."""
LONGEST_BATCH: Final = 32
"""Maximum number of steps per call, if there is no pace and nothing is due."""
BATCH_NS: Final = 100_000
"""Maximum wall time of such a batch, and thus of the delay of a control [ns]."""


SHORTEST_SHARE: Final = 0.5
"""Minimum time between two steps as a fraction of the period, if nodes use the simulation's time.

If late steps followed each other immediately, these nodes would miss most of their ticks. Instead,
on an overloaded machine the simulation slows down and nodes keep their rates.
"""


class Times(Protocol):
    """The steps after which an output is published."""

    @property
    def next_step(self) -> int:
        """The next of these steps."""

    def pass_step(self, step: int) -> None:
        """Find the next of these steps after `step`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedOutput:
    """An output and the steps after which it is published."""

    times: Times
    publish: Callable[[int], None]
    """Called after each of these steps with the step's stamp [ns]."""
    restart: Callable[[], None] | None = None
    """Called at a reset and before the first step; None if the output has no state."""


class TimeOutput(Protocol):
    """Publishes the simulated time."""

    def advance(self) -> None:
        """Publish the time after steps."""

    def restart(self) -> None:
        """Publish the time of a reset, because the next step may be far away."""


class _NoTimeOutput:
    def advance(self) -> None: ...

    def restart(self) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StepReport:
    """Measurements over one second of wall time."""

    realtime_factor: float
    """Simulation time per wall time."""
    overruns: int
    """How often steps were skipped in this second."""
    lost_s: float
    """Wall time of the skipped steps [s]."""


class SkippedTime:
    """Sums up the steps that a simulation skips: one warning at once, then one every 10 s."""

    def __init__(self) -> None:
        self._unreported: list[StepReport] | None = None
        """The seconds since the last warning; None: skipped steps are reported at once."""

    def add(self, report: StepReport) -> str | None:
        """Add a second; return the warning that is due after it."""
        seconds = [*(self._unreported or ()), report]
        if self._unreported is not None and len(seconds) < WARNING_S:
            self._unreported = seconds
            return None
        overruns = sum(each.overruns for each in seconds)
        self._unreported = [] if overruns else None
        if not overruns:
            return None
        period = "second" if len(seconds) == 1 else f"{len(seconds)} s"
        factor = sum(each.realtime_factor for each in seconds) / len(seconds)
        return (
            f"simulation could not keep up: skipped {sum(each.lost_s for each in seconds):.3f} s "
            f"in the last {period} ({with_number(overruns, 'time')}); "
            f"real-time factor {factor:.3f}"
        )


class Stepper:
    """Steps a simulation while `run` is running."""

    def __init__(
        self,
        simulation: Simulation,
        *,
        pace: Pace | None,
        clock: Clock,
        outputs: Sequence[TimedOutput],
        stamp: Callable[[], int],
        warn: Callable[[str], None],
        report: Callable[[StepReport], None],
        ticks: TickCounter | None = None,
        time_output: TimeOutput | None = None,
    ) -> None:
        """Create a stepper without starting it.

        Args:
            simulation: the simulation to step; no other thread may use it while `run` is running.
            pace: schedule of the steps; None to step as fast as possible.
            clock: the wall clock of `pace`.
            outputs: the outputs to publish.
            stamp: returns the stamp of the current step [ns].
            warn: called with MuJoCo's warnings.
            report: called about once per second of wall time.
            ticks: counts the steps of `pace`, by `clock`.
            time_output: publishes the time, before the outputs.
        """
        self._simulation = simulation
        self._pace = pace
        self._clock = clock
        self._outputs = tuple(outputs)
        self._times = tuple(output.times for output in self._outputs)
        self._stamp = stamp
        self._warn = warn
        self._report = report
        self._ticks = ticks or TickCounter()
        self._time_output = time_output or _NoTimeOutput()
        self._shortest_share = 0.0 if time_output is None else SHORTEST_SHARE
        self._due = 0
        """The step after which `advance` publishes next."""

    @property
    def is_paced(self) -> bool:
        """Whether the steps follow the wall clock."""
        return self._pace is not None

    def set_speed(self, realtime_factor: float) -> None:
        """Change the speed of the steps from the next `run` on; may be called on any thread.

        Args:
            realtime_factor: simulated time per wall time, > 0.
        """
        self._pace = Pace(self._simulation.step_s / realtime_factor)

    def begin(self) -> None:
        """Count sample times from the current step, and restart the outputs."""
        if self._simulation.steps == 0:
            self._time_output.restart()
        for output in self._outputs:
            output.times.pass_step(self._simulation.steps)
            if self._simulation.steps == 0 and output.restart is not None:
                output.restart()
        self._due = self._next_due()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Step until `stopped`, starting from the current state.

        Raises:
            DivergenceError: the state is no longer finite.
        """
        simulation, pace, clock = self._simulation, self._pace, self._clock
        tick, publish_time = self._ticks.tick, self._time_output.advance
        now_ns = clock.now_ns()
        shortest_ns = 0
        if pace is not None:
            pace.start(now_ns)
            shortest_ns = round(pace.period_ns * self._shortest_share)
        self.begin()
        due = self._next_due()
        meter = _Meter(now_ns=now_ns, steps=simulation.steps, step_s=simulation.step_s)
        count = 0 if pace is None else 1
        while not stopped():
            if pace is None:
                before_ns, now_ns = now_ns, clock.now_ns()
                most = due - simulation.steps
                count = 1 if most == 1 else min(_next_batch(count, now_ns - before_ns), most)
            else:
                deadline_ns = pace.next_deadline_ns(now_ns)
                now_ns = clock.sleep_until_ns(max(deadline_ns, now_ns + shortest_ns), stopped)
                if stopped():
                    break
                tick(now_ns, now_ns - deadline_ns)
            for warning in simulation.advance(count):
                self._warn(warning)
            publish_time()
            if simulation.steps >= due:
                self._publish_due()
                due = self._next_due()
            if now_ns >= meter.next_report_ns:
                self._report(meter.report(now_ns, simulation.steps, pace))

    def step(self) -> None:
        """Take one step and publish what is due after it.

        Raises:
            DivergenceError: the state is no longer finite.
        """
        self.begin()
        self.advance()

    def advance(self) -> None:
        """Take one step, after `begin`, and publish what is due after it.

        Raises:
            DivergenceError: the state is no longer finite.
        """
        for warning in self._simulation.advance(1):
            self._warn(warning)
        self._time_output.advance()
        if self._simulation.steps >= self._due:
            self._publish_due()
            self._due = self._next_due()

    def _next_due(self) -> int:
        never = self._simulation.steps + LONGEST_BATCH
        return min([times.next_step for times in self._times], default=never)

    def _publish_due(self) -> None:
        step = self._simulation.steps
        stamp_ns = self._stamp()
        for output in self._outputs:
            times = output.times
            if times.next_step <= step:
                output.publish(stamp_ns)
                times.pass_step(step)


def _next_batch(count: int, took_ns: int) -> int:
    """Return the size of the next batch, given that `count` steps took `took_ns`."""
    return max(1, min(LONGEST_BATCH, count * BATCH_NS // max(took_ns, 1)))


class _Meter:
    """Compares simulated time with wall time, second by second."""

    def __init__(self, *, now_ns: int, steps: int, step_s: float) -> None:
        self._step_s = step_s
        self._since_ns = now_ns
        self._steps = steps
        self._overruns = 0
        self._lost_s = 0.0
        self.next_report_ns = now_ns + NS_PER_S

    def report(self, now_ns: int, steps: int, pace: Pace | None) -> StepReport:
        simulated_s = (steps - self._steps) * self._step_s
        overruns = pace.overruns if pace else 0
        lost_s = pace.lost_s if pace else 0.0
        report = StepReport(
            realtime_factor=simulated_s * NS_PER_S / (now_ns - self._since_ns),
            overruns=overruns - self._overruns,
            lost_s=lost_s - self._lost_s,
        )
        self._since_ns, self._steps = now_ns, steps
        self._overruns, self._lost_s = overruns, lost_s
        self.next_report_ns = now_ns + NS_PER_S
        return report
