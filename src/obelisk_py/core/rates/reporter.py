"""A node's promises, told once a second on `/diagnostics` while the node is active.

Other measured numbers stand beside them. Promises are made at configure, hold from activate to
deactivate, and are forgotten at cleanup. A node without any has no publisher for them.
"""

import time
from collections.abc import Callable
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from obelisk_py.core.rates.counter import TickCounter
from obelisk_py.core.rates.promise import NS_PER_S, Promise
from obelisk_py.core.rates.ticks import SampleTicks, TimerTicks
from obelisk_spec.runtime_protocol import (
    DIAGNOSTICS_TOPIC,
    REPORT_PERIOD_S,
    STANDINGS,
    Rate,
    rate_name,
    rate_values,
)

__all__ = ["PARAMETER", "RateReporter"]

PARAMETER: Final = "report_rates"
"""The ROS parameter that switches the reports off; the counting costs less than asking for it."""
_DEPTH: Final = 1
_LEVELS: Final = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class RateReporter:
    """The promises of one node."""

    def __init__(self, node: Node) -> None:
        """Make one without promises."""
        self._node = node
        self._promises: list[Promise] = []
        self._timers: list[TimerTicks] = []
        self._told: dict[str, float] = {}
        self._publisher: Publisher | None = None
        self._timer: Timer | None = None

    def promise_timer(self, name: str, period_s: float, clock: Clock) -> TimerTicks:
        """Promise the rate of a timer on this clock; what is given has to see its calls."""
        is_steady = clock.clock_type == ClockType.STEADY_TIME
        now_ns = time.monotonic_ns if is_steady else lambda: int(clock.now().nanoseconds)
        counter = TickCounter()
        ticks = TimerTicks(counter, period_ns=round(period_s * NS_PER_S), clock=now_ns)
        self._timers.append(ticks)
        self.promise(name, 1 / period_s, counter, now_ns)
        return ticks

    def promise_samples(
        self, name: str, period_s: float, clock: Callable[[], int]
    ) -> Callable[[], None]:
        """Promise the rate of a sensor group in simulation time; to be called at each sample."""
        counter = TickCounter()
        self.promise(name, 1 / period_s, counter, clock)
        return SampleTicks(counter, period_ns=round(period_s * NS_PER_S), clock=clock).tick

    def promise(
        self,
        name: str,
        wanted_hz: float,
        counter: TickCounter,
        clock: Callable[[], int | None],
    ) -> None:
        """Promise a rate; the arguments are those of `Promise`."""
        self._promises.append(Promise(name=name, wanted_hz=wanted_hz, counter=counter, clock=clock))

    def tell(self, name: str, value: float) -> None:
        """Have the next report tell a measured number beside the promises; from any thread."""
        self._told[name] = value

    def start(self) -> None:
        """The promises hold from now on."""
        if not self._promises or not self._node.get_parameter(PARAMETER).value:
            return
        if self._publisher is None:
            self._publisher = self._node.create_publisher(
                DiagnosticArray, DIAGNOSTICS_TOPIC, _DEPTH
            )
            self._timer = self._node.create_timer(
                REPORT_PERIOD_S,
                self._report,
                # Not held up by a coroutine of the user's, and with several threads by no callback.
                # A new one: a group keeps a dead reference for every entity that it ever held.
                callback_group=MutuallyExclusiveCallbackGroup(),
                clock=Clock(clock_type=ClockType.STEADY_TIME),
                autostart=False,
            )
        assert self._timer is not None
        if self._timer.is_canceled():
            for ticks in self._timers:
                ticks.begin()
            for promise in self._promises:
                promise.begin()
            self._timer.reset()

    def stop(self) -> None:
        """Nothing is promised any more."""
        if self._timer is not None:
            self._timer.cancel()

    def forget(self) -> None:
        """Let all promises go."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._timer = self._publisher = None
        self._promises.clear()
        self._timers.clear()
        self._told.clear()

    def _report(self) -> None:
        assert self._publisher is not None
        node = self._node.get_fully_qualified_name()
        told, self._told = self._told, {}
        promised = [_status(node, promise.read()) for promise in self._promises]
        measured = [_number_status(node, name, value) for name, value in told.items()]
        message = DiagnosticArray(status=[*promised, *measured])
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


def _number_status(node: str, name: str, value: float) -> Any:
    text = f"{value:.6g}"
    return DiagnosticStatus(
        level=DiagnosticStatus.OK,
        name=rate_name(node, name),
        message=text,
        hardware_id=node,
        values=[KeyValue(key=name, value=text)],
    )
