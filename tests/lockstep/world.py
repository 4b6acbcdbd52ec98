"""Nodes in lockstep without a config, for tests of the engine."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep.interception import intercepted
from obelisk_py.core.lockstep.scheduler import NS_PER_S
from obelisk_py.core.lockstep.surroundings import LockstepRun

__all__ = ["World", "lockstep_process", "seconds"]

Node = Any


@contextmanager
def lockstep_process() -> Iterator[None]:
    """Simulate time inside the `with` block, and hide this process's nodes from other processes."""
    with pytest.MonkeyPatch.context() as patch, intercepted():
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        yield
        gc.collect()
        rclpy.shutdown()


class World:
    """A run and the nodes that a test adds to it."""

    def __init__(self, **options: Any) -> None:
        """Create an empty run; the options are those of `LockstepRun`."""
        self.lockstep = LockstepRun(**options)
        self.scheduler = self.lockstep.scheduler
        self._nodes: list[tuple[str, Node]] = []

    @property
    def notes(self) -> list[str]:
        """The log of the run."""
        return self.scheduler.notes

    @property
    def log(self) -> list[str]:
        """The log messages of the nodes."""
        return [entry.text for entry in self.lockstep.interception.log]

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self.scheduler.now_ns / NS_PER_S

    def node(
        self,
        name: str = "node",
        make: Callable[[str], Node] = GuardedLifecycleNode,
        *,
        compute_s: float = 0.0,
    ) -> Node:
        """Create an active node."""
        with self.lockstep.entered():
            full_name = f"/{name}"
            node = self.lockstep.make_node(full_name, lambda: make(name), compute_s)
            self._nodes.append((full_name, node))
            scheduled = self.lockstep.nodes[full_name]
            self.scheduler.run_as(scheduled, node.trigger_configure)
            self.scheduler.run_as(scheduled, node.trigger_activate)
        return node

    def run(self, duration_s: float) -> None:
        """Advance time."""
        with self.lockstep.entered():
            self.scheduler.run_until(self.scheduler.now_ns + round(duration_s * NS_PER_S))

    def at(self, node: Node, t: float, call: Callable[[], object]) -> None:
        """Call a function in a callback of a node at a time [s]."""
        timer: Any = None

        def once() -> object:
            timer.cancel()
            return call()

        timer = node.create_timer(t - self.t, once)

    def close(self) -> None:
        """Destroy the nodes."""
        with self.lockstep.entered():
            while self._nodes:
                name, node = self._nodes.pop()
                scheduled = self.lockstep.nodes[name]
                self.lockstep.kill(scheduled)
                for each in (*scheduled.others, node):
                    self.scheduler.run_as(scheduled, each.destroy_node)
                scheduled.node = None
                scheduled.others.clear()
                del node
            self.lockstep.close()
        gc.collect()  # otherwise the nodes would keep their names in rcl


def seconds(node: Node) -> float:
    """The time of a node's clock [s], to the nanosecond."""
    return float(round(node.get_clock().now().nanoseconds / NS_PER_S, 9))
