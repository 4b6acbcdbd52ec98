"""Nodes spun from their first callback to their end: what a process of one and of many share.

In: what `spin_obelisk` was asked for. Out: an exit code, after every node was brought down in
order. Who spins is the process itself, unless a host has taken its place (see `composition`).
"""

import faulthandler
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import rclpy
from rclpy.executors import Executor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from obelisk_py.core.end_signals import EndSignals
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.faults import Fault
from obelisk_py.core.gate import wait_at_gate
from obelisk_py.core.lifecycle import GuardedLifecycleNode

__all__ = ["NodeDied", "Wanted", "ros_process", "spin_nodes", "spin_wanted", "spun_by"]

NEARLY_FOR_EVER_S = 3e8
"""Ten years [s]: without a timeout rclpy's EventsExecutor overflows and runs no callback at all."""
STDERR_FD = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What `spin_obelisk` was asked for."""

    args: tuple[str, ...]
    """The command line, `--ros-args ...` somewhere in it."""
    make: Callable[[], GuardedLifecycleNode]
    executor_type: Callable[..., Executor] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeDied:
    """A node that cannot go on, and why."""

    node: GuardedLifecycleNode
    fault: Fault


def spin_wanted(wanted: Wanted) -> int:
    """Spin a node until its end; the exit code of its process."""
    return _spinner.get()(wanted)


@contextmanager
def spun_by(spinner: Callable[[Wanted], int]) -> Iterator[None]:
    """While entered, `spin_obelisk` hands what it was asked for to this host."""
    token = _spinner.set(spinner)
    try:
        yield
    finally:
        _spinner.reset(token)


@contextmanager
def ros_process(args: Sequence[str]) -> Iterator[EndSignals]:
    """A process that runs nodes: its ROS context, its signals, and its stacks when asked for.

    SIGUSR1 writes the stack of every thread to the standard error, and so does a crash.
    """
    faulthandler.enable(STDERR_FD)
    faulthandler.register(signal.SIGUSR1, STDERR_FD)
    with EndSignals() as signals:
        # rclpy's own handlers end the context before the nodes could be brought down in order.
        rclpy.init(args=list(args), signal_handler_options=SignalHandlerOptions.NO)
        try:
            yield signals
        finally:
            rclpy.try_shutdown()


def spin_nodes(
    executor: Executor, nodes: Sequence[GuardedLifecycleNode], signals: EndSignals
) -> NodeDied | None:
    """Spin until a signal, or until a node cannot go on; then bring all down, the last one first.

    Raises:
        BaseException: what came out of a callback that is no node's own; the nodes are down.

    Returns:
        Of the nodes that cannot go on the first.
    """
    died: list[NodeDied] = []
    over = Future()

    def bring_down() -> None:
        executor.create_task(_bring_all_down, nodes)

    def note(node: GuardedLifecycleNode) -> None:
        fault = node.ended.result()
        if fault is not None:
            died.append(NodeDied(node=node, fault=fault))
            bring_down()
        if all(other.ended.done() for other in nodes) and not over.done():
            over.set_result(None)

    for node in nodes:
        executor.add_node(node)
        node.ended.add_done_callback(lambda _, node=node: note(node))
    signals.hand_to(bring_down)
    try:
        executor.spin_until_future_complete(over, timeout_sec=NEARLY_FOR_EVER_S)
    except BaseException:
        # Not a callback of a node's own, those are guarded; they still do not just vanish.
        _bring_all_down(nodes)
        raise
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()
    return died[0] if died else None


def _spin_alone(wanted: Wanted) -> int:
    # Before the handlers of signals are there: a process that waits ends at once.
    wait_at_gate()
    with ros_process(wanted.args) as signals:
        executor = (wanted.executor_type or EventLoopExecutor)()
        try:
            died = spin_nodes(executor, [wanted.make()], signals)
        finally:
            executor.shutdown()
    return int(died is not None)


def _bring_all_down(nodes: Sequence[GuardedLifecycleNode]) -> None:
    for node in reversed(nodes):
        if not node.ended.done():
            _bring_down(node)


def _bring_down(node: GuardedLifecycleNode) -> None:
    """Deactivate, clean up and shut down, or straight from where a step does not get further."""
    steps = {
        "active": node.trigger_deactivate,
        "inactive": node.trigger_cleanup,
        "unconfigured": node.trigger_shutdown,
    }
    fault = None
    while (state := node.state_label) in steps:
        if steps[state]() != TransitionCallbackReturn.SUCCESS:
            fault = node.last_fault
        if node.state_label == state:
            node.trigger_shutdown()
            break
    if not node.ended.done():
        node.ended.set_result(fault)


_spinner: ContextVar[Callable[[Wanted], int]] = ContextVar("spinner", default=_spin_alone)
