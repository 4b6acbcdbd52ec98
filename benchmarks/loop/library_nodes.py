"""Nodes that inherit from the library's base classes, run as `obk launch` runs them.

A single node runs in `spin_obelisk`, several nodes run in the host of composed processes. The
nodes activate themselves, because there is no launcher.
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

ACTIVATE_AFTER_S = 0.02
"""Time after which a spinning node activates itself [s]."""


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
        activate_soon(self)

    def apply_control(self, control_msg: Any) -> None:
        self.work.receive(control_msg)

    def publish_encoders(self) -> None:
        self.obk_publishers["pub_sensor"].publish(self.work.tick())


class Estimator(ObeliskEstimator):
    """Publishes the received encoder values as an estimate."""

    def __init__(self, name: str, work: Work, period_s: float) -> None:
        self.work = work
        super().__init__(
            name, EstimatedState, parameter_overrides=settings("sensor", work, "est", period_s)
        )
        self.register_obk_subscription(
            "sub_sensor_setting", self.work.receive, key="sub_sensor", msg_type=ObkJointEncoders
        )
        activate_soon(self)

    def compute_state_estimate(self) -> Any:
        estimate = self.work.tick()
        self.obk_publishers["pub_est"].publish(estimate)
        return estimate


class Controller(ObeliskController):
    """Publishes the same setpoint each time."""

    def __init__(self, name: str, work: Work, period_s: float) -> None:
        self.work = work
        super().__init__(
            name,
            PositionSetpoint,
            EstimatedState,
            parameter_overrides=settings("est", work, "ctrl", period_s),
        )
        activate_soon(self)

    def update_x_hat(self, x_hat_msg: Any) -> None:
        self.work.receive(x_hat_msg)

    def compute_control(self) -> Any:
        control = self.work.tick()
        self.obk_publishers["pub_ctrl"].publish(control)
        return control


KINDS: dict[str, tuple[type[Any], str]] = {
    "sim": (Simulator, "timer_sensor"),
    "est": (Estimator, "timer_est"),
    "ctrl": (Controller, "timer_ctrl"),
}
"""Role -> the class and the key of its timer."""
NODES: list[Any] = []
"""All nodes of this process."""


def settings(receives: str, work: Work, sends: str, period_s: float) -> list[Parameter]:
    """The ROS parameters of a node that has a subscription, a publisher and a timer."""
    depth = f"history_depth: {HISTORY_DEPTH}"
    values = {
        f"sub_{receives}_setting": f"{{topic: {work.subscribes_to}, {depth}}}",
        f"pub_{sends}_setting": f"{{topic: {work.publishes_on}, {depth}}}",
        f"timer_{sends}_setting": f"{{timer_period_sec: {period_s}}}",
    }
    return [Parameter(name, value=value) for name, value in values.items()]


def activate_soon(node: ObeliskNode) -> None:
    """Let a node activate itself on the thread that spins it."""

    def activate() -> None:
        starter.cancel()
        node.trigger_configure()
        node.trigger_activate()

    starter = node.create_timer(ACTIVATE_AFTER_S, activate)
    NODES.append(node)


def main() -> None:
    """Run one node; its name, rate [Hz] and joints are the command-line arguments."""
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
    """All nodes of a process."""

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
        """Run until `end`; exit the process if a node dies."""
        if len(self._programs) == 1:
            with self._programs[0].command_line():
                main()
        elif code := run_composed(self._programs):
            sys.exit(code)

    def have_received(self) -> bool:
        """Whether each node has received a message."""
        return len(NODES) == len(self._programs) and all(n.work.notes.has_received for n in NODES)

    def records(self) -> list[NodeRecord]:
        """The records of all nodes."""
        return [
            record_of(
                node.get_name(),
                node.work.notes,
                node.obk_timers[KINDS[node.get_name().partition("_")[0]][1]],
            )
            for node in NODES
        ]

    def end(self) -> None:
        """Shut down the process cleanly; called from another thread."""
        os.kill(os.getpid(), signal.SIGTERM)
