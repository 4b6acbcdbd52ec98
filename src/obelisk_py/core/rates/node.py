"""`RatedNode`: a life-cycle node that promises rates and tells how it keeps them.

Promises are made at configure, hold while the node is active, and are forgotten with what configure
built.
"""

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.timer import Timer

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.rates.reporter import PARAMETER, RateReporter

__all__ = ["RatedNode"]


class RatedNode(GuardedLifecycleNode):
    """A guarded life-cycle node with promises; the ROS parameter `report_rates` silences them."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        """Make the node; the arguments are those of the base."""
        super().__init__(node_name, **kwargs)
        self.declare_parameter(PARAMETER, True)
        # Whoever listens would take a node that falls silent for one that does not tick.
        self._parameter_rules.add((PARAMETER,))
        self.rates = RateReporter(self)
        """The node's promises."""

    def create_promised_timer(
        self,
        name: str,
        period_s: float,
        callback: Callable[[], Any],
        *,
        group: CallbackGroup | None,
        clock: Clock,
    ) -> Timer:
        """A timer that stands still, and whose rate is a promise once the node is active."""
        ticks = self.rates.promise_timer(name, period_s, clock)
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
            self.rates.forget()
