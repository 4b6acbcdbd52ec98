"""Step a simulation at its pace, and publish the outputs that are due.

In: a simulation, a pace, outputs with their sample times. Out: calls of the outputs on the thread
that runs the loop, a report each second of wall time. Knows no ROS and starts no thread.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from obelisk_py.core.rate_monitor import TickCounter
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import NS_PER_S, Clock, Pace

__all__ = ["StepReport", "Stepper", "TimeOutput", "TimedOutput", "Times"]

LONGEST_BATCH: Final = 32
"""Steps taken in one call where no pace holds them back and nothing is due."""
BATCH_NS: Final = 100_000
"""Wall time that such a batch may take [ns]; a control waits for so long at most."""


SHORTEST_SHARE: Final = 0.5
"""Least time between two steps, as a share of the period, where nodes follow the simulation's time.

In steps that follow at once, to make up for lateness, they would miss most of their ticks. On a
machine that is too busy the simulation becomes slower instead, and nodes keep their rates.
"""


class Times(Protocol):
    """The steps after which something is published."""

    @property
    def next_step(self) -> int:
        """The next of them."""

    def pass_step(self, step: int) -> None:
        """Find the next one after `step`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedOutput:
    """An output and the steps after which it is published."""

    times: Times
    publish: Callable[[int], None]
    """Called after a step that `times` names; the argument is the stamp of that step [ns]."""
    restart: Callable[[], None] | None = None
    """Called at a reset and before the first step; None where nothing is carried over."""


class TimeOutput(Protocol):
    """Publishes the simulation time."""

    def advance(self) -> None:
        """Publish the time after steps."""

    def restart(self) -> None:
        """Publish the time of a reset, which no step may follow for long."""


class _NoTimeOutput:
    def advance(self) -> None: ...

    def restart(self) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StepReport:
    """Figures of a second of wall time."""

    realtime_factor: float
    """Simulation time over wall time."""
    overruns: int
    """How often steps were skipped in this second."""
    lost_s: float
    """Wall time of the skipped steps [s]."""


class Stepper:
    """Steps one simulation for as long as `run` runs."""

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
        """Make a stepper that is not running.

        Args:
            simulation: the simulation to step; no other thread may use it while `run` runs.
            pace: when steps are due; None: one after another, as fast as possible.
            clock: the wall clock of `pace`.
            outputs: the outputs to publish.
            stamp: gives the stamp of the present step [ns].
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

    def begin(self) -> None:
        """Count sample times from the present step, and restart the outputs."""
        if self._simulation.steps == 0:
            self._time_output.restart()
        for output in self._outputs:
            output.times.pass_step(self._simulation.steps)
            if self._simulation.steps == 0 and output.restart is not None:
                output.restart()
        self._due = self._next_due()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Step until `stopped`, from where the simulation is.

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
        meter = _Meter(now_ns=now_ns, step_s=simulation.step_s)
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
    """How many steps to take at once, when `count` of them took `took_ns`."""
    return max(1, min(LONGEST_BATCH, count * BATCH_NS // max(took_ns, 1)))


class _Meter:
    """Compares simulation time with wall time, second by second."""

    def __init__(self, *, now_ns: int, step_s: float) -> None:
        self._step_s = step_s
        self._since_ns = now_ns
        self._steps = 0
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
