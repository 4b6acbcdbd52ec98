"""Publish the rates of a node once a second on `/diagnostics`, while the node is active.

Other measured values are published with them. Rates are registered at configure, monitored from
activate to deactivate, and removed at cleanup. A node without any has no publisher for them.
"""

import time
from collections.abc import Callable
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.rate_monitor.counting import (
    NS_PER_S,
    ExpectedRate,
    SampleTicks,
    TickCounter,
    TimerTicks,
)
from obelisk_py.core.shared_clock import SharedClock
from obelisk_spec.runtime_protocol import (
    DIAGNOSTICS_TOPIC,
    REPORT_PERIOD_S,
    STANDINGS,
    Rate,
    rate_name,
    rate_values,
)

__all__ = ["REPORT_RATES", "RateMonitoredNode", "RateReporter"]

REPORT_RATES: Final = "report_rates"
"""The ROS parameter that switches reports off; counting costs less than checking for it."""
_DEPTH: Final = 1
_LEVELS: Final = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class RateReporter:
    """The monitored rates of one node."""

    def __init__(self, node: Node) -> None:
        """Make one without rates."""
        self._node = node
        self._rates: list[ExpectedRate] = []
        self._timers: list[TimerTicks] = []
        self._values: dict[str, float] = {}
        self._publisher: Publisher | None = None
        self._timer: Timer | None = None

    def expect_timer(self, name: str, period_s: float, clock: Clock) -> TimerTicks:
        """Monitor the rate of a timer on this clock; returns the counter of its calls."""
        is_steady = clock.clock_type == ClockType.STEADY_TIME
        now_ns = time.monotonic_ns if is_steady else lambda: int(clock.now().nanoseconds)
        counter = TickCounter()
        # The time that the timer was called at: the page's may have moved since.
        called_ns = (lambda: clock.synced_ns) if isinstance(clock, SharedClock) else now_ns
        ticks = TimerTicks(counter, period_ns=round(period_s * NS_PER_S), clock=called_ns)
        self._timers.append(ticks)
        self.expect(name, 1 / period_s, counter, now_ns)
        return ticks

    def expect_samples(
        self, name: str, period_s: float, clock: Callable[[], int]
    ) -> Callable[[], None]:
        """Monitor a sensor group in simulation time; returns what to call at each sample."""
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
        """Monitor a rate; the arguments are those of `ExpectedRate`."""
        self._rates.append(
            ExpectedRate(name=name, expected_hz=expected_hz, counter=counter, clock=clock)
        )

    def add_value(self, name: str, value: float) -> None:
        """Publish a measured value with the next report; from any thread."""
        self._values[name] = value

    def start(self) -> None:
        """Start to monitor and to publish."""
        if not self._node.get_parameter(REPORT_RATES).value:
            return
        if self._publisher is None:
            # Without rates too: it shows the launcher that there are none to measure from outside.
            self._publisher = self._node.create_publisher(
                DiagnosticArray, DIAGNOSTICS_TOPIC, _DEPTH
            )
        if not self._rates:
            return
        if self._timer is None:
            self._timer = self._node.create_timer(
                REPORT_PERIOD_S,
                self._report,
                # A group of its own, so that no coroutine of the user blocks it. A new one each
                # time, because a group keeps a dead reference for every entity that it ever held.
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
        node = self._node.get_fully_qualified_name()
        values, self._values = self._values, {}
        rates = [_status(node, rate.read()) for rate in self._rates]
        measured = [_value_status(node, name, value) for name, value in values.items()]
        message = DiagnosticArray(status=[*rates, *measured])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def _status(node: str, rate: Rate) -> Any:
    return DiagnosticStatus(
        level=_LEVELS[STANDINGS.index(rate.standing)],
        name=rate_name(node, rate.name),
        message=f"{rate.standing}: {rate.measured_hz:.4g} of {rate.wanted_hz:.4g} Hz",
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


class RateMonitoredNode(GuardedLifecycleNode):
    """A guarded life-cycle node that publishes its rates, unless `report_rates` is false."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Make the node; the arguments are those of the base."""
        super().__init__(node_name, **kwargs)
        self.declare_parameter(REPORT_RATES, True)
        # A node that stops reporting looks like one that does not tick, so it is read at configure.
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
        """A stopped timer, whose rate is monitored while the node is active."""
        ticks = self.rates.expect_timer(name, period_s, clock)
        timer = self.create_timer(
            period_s, ticks.counted(callback), callback_group=group, clock=clock, autostart=False
        )
        ticks.follow(timer)
        return timer

    def _settle(self, state: str) -> None:
        super()._settle(state)
        if state == "active":
            self.rates.start()
            return
        self.rates.stop()
        if state != "inactive":
            self.rates.clear()
