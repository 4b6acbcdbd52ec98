"""Run one Obelisk node as a process, or take it through its lifecycle in a test."""

import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

from rclpy.executors import Executor
from rclpy.lifecycle import TransitionCallbackReturn

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.parameter import parameters_of
from obelisk_py.core.spinning import SpinRequest, serve_spin_request

__all__ = ["run_transitions", "spin_obelisk"]

Transition = Literal["configure", "activate", "deactivate", "cleanup", "shutdown"]


def spin_obelisk(
    args: Sequence[str] | None,
    node_type: Callable[..., GuardedLifecycleNode],
    executor_type: Callable[..., Executor] | None = None,
    node_kwargs: Mapping[str, Any] | None = None,
) -> None:
    """Create a node and spin it until SIGINT, SIGTERM, or an unrecoverable fault.

    On a signal, the node is deactivated, cleaned up and shut down; a second signal terminates the
    process immediately. On SIGUSR1, the stack of every thread is written to stderr. In a composed
    process, the node is spun together with the others, on a shared executor.

    Args:
        args: command line with `--ros-args ...`; None for that of the process.
        node_type: the node class.
        executor_type: an rclpy executor class. By default, and for rclpy's single- and
            multi-threaded executors, the library's `EventLoopExecutor` runs the callbacks with the
            same guarantees. `OBK_EXECUTOR=rclpy` selects rclpy's own.
        node_kwargs: passed to the node class.

    Raises:
        SystemExit: with code 1, if the node failed.
    """
    code = serve_spin_request(
        SpinRequest(
            args=tuple(sys.argv if args is None else args),
            make=partial(_create, node_type, node_kwargs or {}),
            executor_type=executor_type,
        )
    )
    if code:
        sys.exit(code)


def _create(
    node_type: Callable[..., GuardedLifecycleNode], node_kwargs: Mapping[str, Any]
) -> GuardedLifecycleNode:
    """Create a node, and explain why one of its parameters has no value yet."""
    try:
        return node_type(**node_kwargs)
    except AttributeError as error:
        if error.name not in parameters_of(type(error.obj)):
            raise
        place = traceback.extract_tb(error.__traceback__)[-1]
        raise ObeliskConfigError(
            f"the parameter `{error.name}` has no value before `super().__init__(...)`; use it "
            f"after that call ({place.filename}:{place.lineno})"
        ) from error


def run_transitions(node: GuardedLifecycleNode, *transitions: Transition) -> None:
    """Run transitions one after another on this thread; for tests of a node.

    Args:
        node: the node, without an executor.
        transitions: names, as in `run_transitions(node, "configure", "activate")`.

    Raises:
        ObeliskError: a transition failed; the message contains the node's reason.
    """
    for transition in transitions:
        if getattr(node, f"trigger_{transition}")() != TransitionCallbackReturn.SUCCESS:
            raise ObeliskError(f"`{node.get_name()}` did not {transition}: {node.last_fault}")
