"""Plain rclpy nodes on a chosen executor."""

from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from benchmarks.loop.cases import BASELINE
from benchmarks.loop.record import NodeRecord, record_of
from benchmarks.loop.work import HISTORY_DEPTH, work_of
from obelisk_py.core.executor import EventLoopExecutor

__all__ = ["PlainNodes"]

EXECUTORS: dict[str, Callable[[], Any]] = {
    BASELINE: SingleThreadedExecutor,
    "rclpy MultiThreadedExecutor": MultiThreadedExecutor,
    "rclpy EventsExecutor": EventsExecutor,
    "obelisk executor": EventLoopExecutor,
}
NEARLY_FOR_EVER_S = 3e8
"""Ten years [s]: without a timeout rclpy's EventsExecutor overflows and runs no callback at all."""


class PlainNode(Node):
    """One timer, one publisher, one subscription."""

    def __init__(self, name: str, rate_hz: int, joints: int) -> None:
        super().__init__(name)
        self.work = work_of(name, joints)
        self.create_subscription(
            self.work.receives, self.work.subscribes_to, self.work.receive, HISTORY_DEPTH
        )
        self._publisher = self.create_publisher(
            self.work.sends, self.work.publishes_on, HISTORY_DEPTH
        )
        self.timer = self.create_timer(1 / rate_hz, self._tick)

    def _tick(self) -> None:
        self._publisher.publish(self.work.tick())


class PlainNodes:
    """All nodes of a process."""

    def __init__(self, names: Sequence[str], contestant: str, rate_hz: int, joints: int) -> None:
        rclpy.init()
        self._nodes = [PlainNode(name, rate_hz, joints) for name in names]
        self._executor = EXECUTORS[contestant]()
        for node in self._nodes:
            self._executor.add_node(node)
        self._over = Future()

    def spin(self) -> None:
        """Run until `end`."""
        try:
            self._executor.spin_until_future_complete(self._over, timeout_sec=NEARLY_FOR_EVER_S)
        except ExternalShutdownException:
            return
        rclpy.try_shutdown()

    def have_received(self) -> bool:
        """Whether each node has received a message."""
        return all(node.work.notes.has_received for node in self._nodes)

    def records(self) -> list[NodeRecord]:
        """The records of all nodes."""
        return [record_of(node.get_name(), node.work.notes, node.timer) for node in self._nodes]

    def end(self) -> None:
        """Make `spin` return; called from another thread."""
        self._over.set_result(None)
        self._executor.wake()
