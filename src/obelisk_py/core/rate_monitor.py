"""Measure the rates of a node's timers and sensor groups, and publish them on `/diagnostics`.

A `TickCounter` uses a fixed amount of memory. It counts lateness in buckets, 16 for each factor of
two. A reported lateness is therefore at most 1/16 too high and never too low; below about 1 us it
is 0. The calls of a timer or sensor group update the counter, and an `ExpectedRate` reads it once a
second.

`configure` registers the rates. They are monitored and published, together with other measured
values, from `activate` to `deactivate`. `cleanup` removes them.
"""

import functools
import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.shared_clock import SharedClock
from obelisk_spec.runtime_protocol import (
    ACTIVATION,
    DIAGNOSTICS_TOPIC,
    FIRST_OUTPUT,
    REPORT_PERIOD_S,
    STANDINGS,
    TOLERANCE,
    Rate,
    Standing,
    hz,
    rate_name,
    rate_values,
)

__all__ = [
    "NS_PER_S",
    "REPORT_RATES",
    "ExpectedRate",
    "RateMonitoredNode",
    "RateReporter",
    "SampleTicks",
    "TickCounter",
    "TimerTicks",
    "late_ns_of",
]

NS_PER_S: Final = 1_000_000_000
NS_PER_US: Final = 1000
BROKEN_S: Final = 2.0
"""A rate that is continuously too low for this long is broken [s]."""
EARLY_S: Final = 0.1
"""How early a read may be, because the previous one was late [s]."""
SHARES: Final = (0.5, 0.99, 1.0)

_SUB_BITS: Final = 4
_SUB_BUCKETS: Final = 1 << _SUB_BITS
_SHORTEST_NS: Final = 1 << 10
_LONGEST_NS: Final = (1 << 37) - 1
"""More than 2 min."""


def _bucket(late_ns: int) -> int:
    shift = late_ns.bit_length() - _SUB_BITS - 1
    return (shift << _SUB_BITS) + (late_ns >> shift)


_FIRST: Final = _bucket(_SHORTEST_NS)
_BUCKETS: Final = _bucket(_LONGEST_NS) + 1


class TickCounter:
    """Ticks and their lateness; one thread may count while another one reads."""

    __slots__ = ("buckets", "newest_ns", "overruns", "ticks")

    def __init__(self) -> None:
        """Create a counter without ticks."""
        self.ticks = 0
        self.overruns = 0
        """Ticks that were skipped or merged with the next one."""
        self.newest_ns = 0
        """Time of the latest tick [ns], on the clock of the caller of `tick`."""
        self.buckets = [0] * _BUCKETS
        """Ticks by lateness; the counts only grow, so readers need not stop the counting."""

    def tick(self, now_ns: int, late_ns: int, skipped: int = 0) -> None:
        """Count a tick.

        Args:
            now_ns: time of the tick [ns].
            late_ns: delay since its due time [ns].
            skipped: ticks since the previous one that were due but did not happen.
        """
        if late_ns < _SHORTEST_NS:
            late_ns = _SHORTEST_NS
        elif late_ns > _LONGEST_NS:
            late_ns = _LONGEST_NS
        shift = late_ns.bit_length() - _SUB_BITS - 1  # `_bucket`, without the call
        # No calls from here on: CPython switches threads only between calls, so a reader never sees
        # a partially counted tick.
        self.buckets[(shift << _SUB_BITS) + (late_ns >> shift)] += 1
        self.ticks += 1
        self.overruns += skipped
        self.newest_ns = now_ns


def late_ns_of(buckets: Sequence[int], shares: Sequence[float]) -> tuple[float, ...]:
    """Return the lateness [ns] at each of these quantiles (0 to 1, ascending).

    Without ticks, all values are 0.
    """
    total = sum(buckets)
    found: list[float] = []
    seen = 0
    for place, count in enumerate(buckets):
        seen += count
        while count and len(found) < len(shares) and seen >= shares[len(found)] * total:
            found.append(_upper_edge_ns(place))
    return (*found, *(0.0,) * (len(shares) - len(found)))


def _upper_edge_ns(place: int) -> float:
    if place == _FIRST:
        return 0.0
    shift = (place >> _SUB_BITS) - 1
    return float(((place % _SUB_BUCKETS + _SUB_BUCKETS + 1) << shift) - 1)


class TimerTicks:
    """Counts the calls of a timer.

    It works with any executor and any clock, because the rcl timer knows its schedule. After a
    call, rcl returns the time until the next call, which is one period after this call was due.
    """

    def __init__(self, counter: TickCounter, *, period_ns: int, clock: Callable[[], int]) -> None:
        """Start counting.

        Args:
            counter: receives the ticks.
            period_ns: the timer's period [ns].
            clock: returns the current time on the timer's clock [ns].
        """
        self._counter = counter
        self._period_ns = period_ns
        self._skips_above_ns = period_ns + period_ns // 2
        self._clock = clock
        self._until_due: Callable[[], int | None] = lambda: None
        self._due_ns: int | None = None
        """When the next tick is due; None before the first tick after a start."""

    def counted(self, callback: Callable[[], Any]) -> Callable[[], Any]:
        """Wrap a timer's callback to count its calls."""

        @functools.wraps(callback)
        async def wait() -> Any:
            self.tick()
            return await callback()

        @functools.wraps(callback)
        def call() -> Any:
            self.tick()
            return callback()

        return wait if inspect.iscoroutinefunction(callback) else call

    def follow(self, timer: Timer) -> None:
        """Set the timer whose calls are counted."""
        self._until_due = timer.handle.time_until_next_call

    def restart(self) -> None:
        """Record that the timer was restarted."""
        self._due_ns = None

    def tick(self) -> None:
        """Count a call of the timer."""
        now_ns = self._clock()
        left_ns = self._until_due()
        if left_ns is None:  # stopped in the meantime
            return
        next_ns = now_ns + left_ns
        due_ns = self._due_ns
        self._due_ns = next_ns
        late_ns, skipped = self._period_ns - left_ns, 0
        if due_ns is not None and next_ns - due_ns > self._skips_above_ns:
            skipped = round((next_ns - due_ns) / self._period_ns) - 1
            late_ns += skipped * self._period_ns
        self._counter.tick(now_ns, late_ns, skipped)


class SampleTicks:
    """Counts samples in simulated time; a sample is due when it is taken, so none is late.

    The lateness of steps in wall time is measured with the steps.
    """

    def __init__(self, counter: TickCounter, *, period_ns: int, clock: Callable[[], int]) -> None:
        """Start counting.

        Args:
            counter: receives the samples.
            period_ns: simulated time between two samples [ns].
            clock: returns the current simulated time [ns].
        """
        self._counter = counter
        self._period_ns = period_ns
        self._skips_above_ns = period_ns + period_ns // 2
        self._clock = clock

    def tick(self) -> None:
        """Count a sample that was taken, or dropped as set in the config."""
        now_ns = self._clock()
        skipped = 0
        if self._counter.ticks:
            passed_ns = now_ns - self._counter.newest_ns
            if passed_ns > self._skips_above_ns:
                skipped = round(passed_ns / self._period_ns) - 1
        self._counter.tick(now_ns, 0, skipped)


class ExpectedRate:
    """An expected rate from the config, and whether it is reached; read once a second.

    Only a rate that is too low is a fault. A scheduled timer cannot run ahead of its schedule, and
    a punctual tick after a late one is normal.
    """

    def __init__(
        self,
        *,
        name: str,
        expected_hz: float,
        counter: TickCounter,
        clock: Callable[[], int | None],
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start monitoring a rate.

        Args:
            name: as in `Rate`.
            expected_hz: expected ticks per second of `clock` [Hz].
            counter: counts the ticks, by `clock`.
            clock: returns the current time [ns]; None while no rate is expected.
            steady_s: returns the time that measures the read intervals, independent of `clock` [s].
        """
        self.name = name
        self._expected_hz = expected_hz
        self._counter = counter
        self._clock = clock
        self._steady_s = steady_s
        self.restart()

    def change(self, expected_hz: float) -> None:
        """Expect another rate from now on."""
        self._expected_hz = expected_hz
        self.restart()

    def restart(self) -> None:
        """Restart the measurement; earlier ticks are ignored."""
        counter = self._counter
        self._first_tick = self._last_tick = counter.ticks
        self._first_overrun = counter.overruns
        self._buckets = counter.buckets.copy()
        self._since_ns = self._clock()
        """Time of the latest tick at the last read, or the start time."""
        self._measured_hz = self._expected_hz
        self._read_s = self._steady_s()
        self._off_s: float | None = None
        """How long the rate has been too low [s]; None to ignore the next read, because the whole
        node is starting up then."""

    def read(self) -> Rate:
        """Return the values since the last read."""
        counter = self._counter
        buckets = counter.buckets.copy()
        newest_ns, ticks = counter.newest_ns, counter.ticks
        self._measure(newest_ns, ticks)
        of_this_read = [now - before for now, before in zip(buckets, self._buckets, strict=True)]
        self._buckets = buckets
        p50_us, p99_us, max_us = (ns / NS_PER_US for ns in late_ns_of(of_this_read, SHARES))
        return Rate(
            name=self.name,
            expected_hz=self._expected_hz,
            measured_hz=self._measured_hz,
            ticks=ticks - self._first_tick,
            overruns=counter.overruns - self._first_overrun,
            late_p50_us=p50_us,
            late_p99_us=p99_us,
            late_max_us=max_us,
            standing=self._standing,
        )

    @property
    def _standing(self) -> Standing:
        if not self._off_s:
            return "kept"
        return "broken" if self._off_s >= BROKEN_S - EARLY_S else "off"

    def _measure(self, newest_ns: int, ticks: int) -> None:
        now_ns, since_ns = self._clock(), self._since_ns
        new = ticks - self._last_tick
        self._last_tick = ticks
        read_s, self._read_s = self._read_s, self._steady_s()
        last_ns = newest_ns if new else now_ns
        if now_ns is None or since_ns is None or last_ns is None or last_ns <= since_ns:
            # No rate was expected, or simulated time was paused or jumped back.
            self._since_ns = now_ns
            self._off_s = None
            self._measured_hz = self._expected_hz
            return
        if new:
            # Measured from tick to tick, because the number of ticks in a second varies by one.
            self._measured_hz = new * NS_PER_S / max(1, newest_ns - since_ns)
            self._since_ns = newest_ns
        # Upper bound: the rate if one more tick happened right now.
        most_hz = (new + 1) * NS_PER_S / max(1, now_ns - since_ns)
        self._measured_hz = min(self._measured_hz, most_hz)
        is_off = self._measured_hz < (1 - TOLERANCE) * self._expected_hz
        # A late read counts only for the last second before it.
        shown_s = min(self._read_s - read_s, REPORT_PERIOD_S)
        self._off_s = 0.0 if self._off_s is None or not is_off else self._off_s + shown_s


Values = Sequence[tuple[str, str]]
"""Keys and values of a diagnostic status."""
REPORT_RATES: Final = "report_rates"
"""The ROS parameter that turns reports off. Counting continues: it is cheaper than a check."""
_DEPTH: Final = 1
_LEVELS: Final = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class RateReporter:
    """The monitored rates of one node."""

    def __init__(self, node: Node) -> None:
        """Create a reporter without rates."""
        self._node = node
        self._rates: list[ExpectedRate] = []
        self._timers: list[TimerTicks] = []
        self._values: dict[str, float] = {}
        self._faults: dict[str, Callable[[], Values | None]] = {}
        self._checks: list[Callable[[], None]] = []
        self._publisher: Publisher | None = None
        self._timer: Timer | None = None

    def expect_timer(self, name: str, period_s: float, clock: Clock) -> TimerTicks:
        """Monitor the rate of a timer on this clock, and return the counter of its calls."""
        is_steady = clock.clock_type == ClockType.STEADY_TIME
        now_ns = time.monotonic_ns if is_steady else lambda: int(clock.now().nanoseconds)
        counter = TickCounter()
        # The time of the call, because the clock page may have advanced since then.
        called_ns = (lambda: clock.synced_ns) if isinstance(clock, SharedClock) else now_ns
        ticks = TimerTicks(counter, period_ns=round(period_s * NS_PER_S), clock=called_ns)
        self._timers.append(ticks)
        self.expect(name, 1 / period_s, counter, now_ns)
        return ticks

    def expect_samples(
        self, name: str, period_s: float, clock: Callable[[], int]
    ) -> Callable[[], None]:
        """Monitor a sensor group in simulated time, and return the function to call per sample."""
        counter = TickCounter()
        self.expect(name, 1 / period_s, counter, clock)
        return SampleTicks(counter, period_ns=round(period_s * NS_PER_S), clock=clock).tick

    def expect(
        self,
        name: str,
        expected_hz: float,
        counter: TickCounter,
        clock: Callable[[], int | None],
    ) -> None:
        """Monitor a rate; for the arguments see `ExpectedRate`."""
        self._rates.append(
            ExpectedRate(name=name, expected_hz=expected_hz, counter=counter, clock=clock)
        )

    def expect_anew(self, name: str, expected_hz: float) -> None:
        """Expect another value of a monitored rate."""
        for rate in self._rates:
            if rate.name == name:
                rate.change(expected_hz)

    def add_value(self, name: str, value: float) -> None:
        """Publish a measured value with the next report; thread-safe."""
        self._values[name] = value

    def watch_fault(self, name: str, read: Callable[[], Values | None]) -> None:
        """Publish the result of `read` with each report, as a status; None publishes nothing."""
        self._faults[name] = read

    def at_each_report(self, check: Callable[[], None]) -> None:
        """Call `check` with each report."""
        self._checks.append(check)

    def start(self) -> None:
        """Start monitoring and publishing."""
        if not self._node.get_parameter(REPORT_RATES).value:
            return
        clock = self._node.get_clock()
        if isinstance(clock, SharedClock):
            # The timers have just been started; they count from the time that rcl had then.
            time_ns = clock.synced_ns if self._timers else clock.page.time_ns
            self.add_value(ACTIVATION, max(0, time_ns) / NS_PER_S)
        if self._publisher is None:
            # Even without rates, so that the launcher knows that it need not measure any itself.
            self._publisher = self._node.create_publisher(
                DiagnosticArray, DIAGNOSTICS_TOPIC, _DEPTH
            )
        if not self._rates and not self._values and not self._faults:
            return
        if self._timer is None:
            self._timer = self._node.create_timer(
                REPORT_PERIOD_S,
                self._report,
                # Its own group, so that no coroutine of the user blocks it. A new one each time,
                # because a group keeps a dead reference for every entity that it has ever held.
                callback_group=MutuallyExclusiveCallbackGroup(),
                clock=Clock(clock_type=ClockType.STEADY_TIME),
                autostart=False,
            )
        if self._timer.is_canceled():
            for ticks in self._timers:
                ticks.restart()
            for rate in self._rates:
                rate.restart()
            self._timer.reset()

    def stop(self) -> None:
        """Stop publishing."""
        if self._timer is not None:
            self._timer.cancel()

    def clear(self) -> None:
        """Remove all rates."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._timer = self._publisher = None
        self._rates.clear()
        self._timers.clear()
        self._values.clear()

    def _report(self) -> None:
        assert self._publisher is not None
        for check in self._checks:
            check()
        node = self._node.get_fully_qualified_name()
        values, self._values = self._values, {}
        rates = [_status(node, rate.read()) for rate in self._rates]
        measured = [_value_status(node, name, value) for name, value in values.items()]
        faults = [
            _fault_status(node, name, found)
            for name, read in self._faults.items()
            if (found := read()) is not None
        ]
        if statuses := [*rates, *measured, *faults]:
            message = DiagnosticArray(status=statuses)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(message)
        if not self._rates and not self._faults:
            self.stop()


def _status(node: str, rate: Rate) -> Any:
    return DiagnosticStatus(
        level=_LEVELS[STANDINGS.index(rate.standing)],
        name=rate_name(node, rate.name),
        message=f"{rate.standing}: {hz(rate.measured_hz)} of {hz(rate.expected_hz)} Hz",
        hardware_id=node,
        values=[KeyValue(key=key, value=value) for key, value in rate_values(rate)],
    )


def _value_status(node: str, name: str, value: float) -> Any:
    text = f"{value:.6g}"
    return DiagnosticStatus(
        level=DiagnosticStatus.OK,
        name=rate_name(node, name),
        message=text,
        hardware_id=node,
        values=[KeyValue(key=name, value=text)],
    )


def _fault_status(node: str, name: str, values: Values) -> Any:
    return DiagnosticStatus(
        level=DiagnosticStatus.ERROR,
        name=rate_name(node, name),
        message=name,
        hardware_id=node,
        values=[KeyValue(key=key, value=value) for key, value in values],
    )


class RateMonitoredNode(GuardedLifecycleNode):
    """A guarded lifecycle node that publishes its rates, unless `report_rates` is false."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Create the node; for the arguments see the base class."""
        super().__init__(node_name, **kwargs)
        self.declare_parameter(REPORT_RATES, True)
        # Read in `configure`, because a node that stops reporting looks like one that does not
        # tick.
        self._parameter_rules.add((REPORT_RATES,))
        self.rates = RateReporter(self)
        """The node's monitored rates."""

    def create_monitored_timer(
        self,
        name: str,
        period_s: float,
        callback: Callable[[], Any],
        *,
        group: CallbackGroup | None,
        clock: Clock,
    ) -> Timer:
        """Create a stopped timer whose rate is monitored while the node is active."""
        if self.surroundings.is_lockstep:
            return self.create_timer(
                period_s, callback, callback_group=group, clock=clock, autostart=False
            )
        ticks = self.rates.expect_timer(name, period_s, clock)
        timer = self.create_timer(
            period_s, ticks.counted(callback), callback_group=group, clock=clock, autostart=False
        )
        ticks.follow(timer)
        return timer

    def _settle(self, state: str) -> None:
        super()._settle(state)
        if state == "active":
            if not self.surroundings.is_lockstep:
                self.rates.start()
                self._note_first_output()
            return
        self.rates.stop()
        if state != "inactive":
            self.rates.clear()

    def _note_first_output(self) -> None:
        """Report the simulated time of the next message; a test can start a trial at that time."""
        clock = self.get_clock()
        publishers = [each for each in self._managed_entities if isinstance(each, Publisher)]
        if not isinstance(clock, SharedClock) or not publishers:
            return

        def note(publisher: Publisher, message: Any) -> None:
            for each in publishers:  # once, so later messages have no extra cost
                vars(each).pop("publish", None)
            self.rates.add_value(FIRST_OUTPUT, clock.page.time_ns / NS_PER_S)
            publisher.publish(message)

        for publisher in publishers:
            setattr(publisher, "publish", functools.partial(note, publisher))  # noqa: B010 - mypy
