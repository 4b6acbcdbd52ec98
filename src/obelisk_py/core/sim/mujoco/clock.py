"""Publish the simulation time: on the clock page of the launch, and as `/clock`.

In: the simulation time after each step. Out: the time on the page after each step, for the Python
nodes of the launch on this host; messages for all others, at a bounded rate, and only while
`/clock` has subscribers.
"""

from collections.abc import Callable
from typing import Final

from rosgraph_msgs.msg import Clock

from obelisk_py.core.clock_page import ClockWriter
from obelisk_py.core.serialization.codec import PackedMessage
from obelisk_py.core.sim.mujoco.outputs import MakePublisher, SubscriberCheck
from obelisk_py.core.sim.mujoco.stepping import NS_PER_S
from obelisk_spec.runtime_protocol import CLOCK_TOPIC

__all__ = ["SimulationClock"]

_DEPTH: Final = 10
"""Of a reliable publisher, which matches reliable and best-effort subscriptions. Nodes ask for best
effort and depth 1 (`ClockQoS` of rclcpp)."""


class SimulationClock:
    """The clock that other nodes follow; all methods run on the stepping thread."""

    def __init__(
        self,
        make_publisher: MakePublisher,
        *,
        page: ClockWriter | None,
        rate_hz: float,
        time_ns: Callable[[], int],
    ) -> None:
        """Make the publisher of `/clock`.

        Args:
            make_publisher: makes a publisher of the robot.
            page: None: the launch has none.
            rate_hz: the highest rate of messages [Hz of simulated time].
            time_ns: the simulation time [ns].
        """
        self._publisher = make_publisher(Clock, CLOCK_TOPIC, _DEPTH)
        self._check = SubscriberCheck(self._publisher.get_subscription_count)
        self._message = PackedMessage(Clock())
        self._period_ns = NS_PER_S / rate_hz
        self._time_ns = time_ns
        self._page = page
        self._count = 0
        """Periods that have passed at the next message."""

    def advance(self) -> None:
        """Publish the time after a step."""
        now_ns = self._time_ns()
        if self._page is not None:
            self._page.advance(now_ns)
        if now_ns < round(self._count * self._period_ns):
            return
        self._count = int(now_ns // self._period_ns) + 1
        if self._check.has_subscribers():
            self._publisher.publish(self._message.to_bytes(now_ns))

    def restart(self) -> None:
        """Publish the time of a reset, which no step may follow for long."""
        now_ns = self._time_ns()
        if self._page is not None:
            self._page.restart(now_ns)
        self._count = int(now_ns // self._period_ns) + 1
        self._publisher.publish(self._message.to_bytes(now_ns))
