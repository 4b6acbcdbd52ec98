"""Shared code for the tests of the executor: nodes in their own context, run in a thread."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from obelisk_py.core.executor import EventLoopExecutor

from ..waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests

__all__ = ["DEADLINE_S", "World", "eventually", "world"]

N = TypeVar("N", bound=Node)


class World:
    """A context with an executor that is not running yet."""

    def __init__(self, num_threads: int = 1) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = EventLoopExecutor(num_threads, context=self.context)
        self._nodes: list[Node] = []

    def node(self, name: str = "node", **options: Any) -> Node:
        """A node that the executor runs."""
        return self.adopt(Node(name, context=self.context, **options))

    def adopt(self, node: N) -> N:
        """Add a node of this context to the executor."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    @contextmanager
    def spinning(self) -> Iterator[None]:
        """Run the callbacks in a thread; their exceptions fail the test."""
        faults: list[BaseException] = []

        def spin() -> None:
            try:
                self.executor.spin()
            except BaseException as fault:
                faults.append(fault)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            self.executor.shutdown()
            thread.join()
        assert not faults

    def run_until(self, condition: Callable[[], object], what: str) -> None:
        """Run callbacks until a condition is true."""
        with self.spinning():
            eventually(condition, what)

    def close(self) -> None:
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self.context.try_shutdown()


@contextmanager
def world(num_threads: int = 1) -> Iterator[World]:
    """A world that is cleaned up after the test."""
    made = World(num_threads)
    try:
        yield made
    finally:
        made.close()
