"""The work in nodes that inherit from the library's base classes, run as `obk launch` runs them.

A process of one node is a call of `spin_obelisk`, one of several the host of composed processes.
The nodes take themselves to active, as no launcher does it.
"""

import os
import signal
import sys
from collections.abc import Sequence
from typing import Any

from obelisk_control_msgs.msg import PositionSetpoint
from obelisk_estimator_msgs.msg import EstimatedState
from obelisk_sensor_msgs.msg import ObkJointEncoders
from rclpy.parameter import Parameter

from benchmarks.loop.record import NodeRecord, record_of
from benchmarks.loop.work import HISTORY_DEPTH, Work, work_of
from obelisk_py.core.composition import Program, run_composed
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.estimation import ObeliskEstimator
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.robot import ObeliskRobot
from obelisk_py.core.utils.ros import spin_obelisk

__all__ = ["LibraryNodes", "main"]

BEGIN_AFTER_S = 0.02
"""When a node that spins takes itself to active [s]."""


class Simulator(ObeliskRobot):
    """Publishes encoders at each tick."""

    def __init__(self, name: str, work: Work, period_s: float) -> None:
        self.work = work
        super().__init__(
            name, PositionSetpoint, parameter_overrides=settings("ctrl", work, "sensor", period_s)
        )
        self.register_obk_timer("timer_sensor_setting", self.publish_encoders, key="timer_sensor")
        self.register_obk_publisher(
            "pub_sensor_setting", key="pub_sensor", msg_type=ObkJointEncoders
        )
        begin_soon(self)

    def apply_control(self, control_msg: Any) -> None:
        self.work.hear(control_msg)

    def publish_encoders(self) -> None:
        self.obk_publishers["pub_sensor"].publish(self.work.tick())


class Estimator(ObeliskEstimator):
    """Hands the encoders on."""

    def __init__(self, name: str, work: Work, period_s: float) -> None:
        self.work = work
        super().__init__(
            name, EstimatedState, parameter_overrides=settings("sensor", work, "est", period_s)
        )
        self.register_obk_subscription(
            "sub_sensor_setting", self.work.hear, key="sub_sensor", msg_type=ObkJointEncoders
        )
        begin_soon(self)

    def compute_state_estimate(self) -> Any:
        estimate = self.work.tick()
        self.obk_publishers["pub_est"].publish(estimate)
        return estimate


class Controller(ObeliskController):
    """Sends the same set point each time."""

    def __init__(self, name: str, work: Work, period_s: float) -> None:
        self.work = work
        super().__init__(
            name,
            PositionSetpoint,
            EstimatedState,
            parameter_overrides=settings("est", work, "ctrl", period_s),
        )
        begin_soon(self)

    def update_x_hat(self, x_hat_msg: Any) -> None:
        self.work.hear(x_hat_msg)

    def compute_control(self) -> Any:
        control = self.work.tick()
        self.obk_publishers["pub_ctrl"].publish(control)
        return control


KINDS: dict[str, tuple[type[Any], str]] = {
    "sim": (Simulator, "timer_sensor"),
    "est": (Estimator, "timer_est"),
    "ctrl": (Controller, "timer_ctrl"),
}
"""Of each role the class, and the key of its timer."""
MADE: list[Any] = []
"""The nodes of this process."""


def settings(hears: str, work: Work, sends: str, period_s: float) -> list[Parameter]:
    """The ROS parameters of a node that has a subscription, a publisher and a timer."""
    depth = f"history_depth: {HISTORY_DEPTH}"
    values = {
        f"sub_{hears}_setting": f"{{topic: {work.subscribes_to}, {depth}}}",
        f"pub_{sends}_setting": f"{{topic: {work.publishes_on}, {depth}}}",
        f"timer_{sends}_setting": f"{{timer_period_sec: {period_s}}}",
    }
    return [Parameter(name, value=value) for name, value in values.items()]


def begin_soon(node: ObeliskNode) -> None:
    """Let a node take itself to active, on the thread that spins it."""

    def begin() -> None:
        starter.cancel()
        node.trigger_configure()
        node.trigger_activate()

    starter = node.create_timer(BEGIN_AFTER_S, begin)
    MADE.append(node)


def main() -> None:
    """The program of one node: its name, rate [Hz] and joints are the command line."""
    name, rate_hz, joints = sys.argv[1:]
    kind, _ = KINDS[name.partition("_")[0]]
    spin_obelisk(
        [],
        kind,
        node_kwargs={
            "name": name,
            "work": work_of(name, int(joints)),
            "period_s": 1 / int(rate_hz),
        },
    )


class LibraryNodes:
    """The nodes of a process."""

    def __init__(self, names: Sequence[str], rate_hz: int, joints: int) -> None:
        self._programs = [
            Program(
                node=f"/{name}",
                module=__name__,
                function=main.__name__,
                arguments=(name, str(rate_hz), str(joints)),
            )
            for name in names
        ]

    def spin(self) -> None:
        """Run until `end`; exits the process where a node dies."""
        if len(self._programs) == 1:
            with self._programs[0].command_line():
                main()
        elif code := run_composed(self._programs):
            sys.exit(code)

    def have_heard(self) -> bool:
        """Whether a message came to each of them."""
        return len(MADE) == len(self._programs) and all(n.work.notes.has_heard for n in MADE)

    def records(self) -> list[NodeRecord]:
        """What was noted."""
        return [
            record_of(
                node.get_name(),
                node.work.notes,
                node.obk_timers[KINDS[node.get_name().partition("_")[0]][1]],
            )
            for node in MADE
        ]

    def end(self) -> None:
        """End the process in order; called from another thread."""
        os.kill(os.getpid(), signal.SIGTERM)
