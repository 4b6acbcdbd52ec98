"""Run the programs of several nodes in this process: `python -m obelisk_py.core.composition FILE`.

The launcher writes FILE as JSON, `{"nodes": [{"node", "module", "function", "arguments"}, ...]}`.
The programs are nested: each one runs until it calls `spin_obelisk`, and the next one runs within
that call. The last call creates all nodes and spins them until shutdown. Then the programs continue
in reverse order. A program's `with open_robot(): spin_obelisk(...)` therefore works as in its own
process, and a failure can be attributed to its program or node. No node is created before every
program has called `spin_obelisk`.
"""

import json
import runpy
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

from rclpy.logging import get_logger, get_logging_severity_from_string, set_logger_level

from obelisk_py.core.clock_page import open_clock_page
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.faults import NodeFault, fault_of
from obelisk_py.core.lifecycle import GuardedLifecycleNode, node_arguments
from obelisk_py.core.spinning import (
    ShutdownSignals,
    SpinRequest,
    ros_process,
    simulated_time_from,
    spin_nodes,
    spin_requests_served_by,
    wait_at_gate,
)

__all__ = [
    "Program",
    "logger_name",
    "main",
    "read_programs",
    "ros_arguments_of",
    "run_composed",
    "set_log_levels",
]

ROS_ARGUMENTS = "--ros-args"
LOG_LEVEL = "--log-level"
HOST = "composed"
"""The logger for messages that belong to no node."""
SWITCH_INTERVAL_S = 1e-4
"""How long a thread may hold the GIL while another thread waits for it [s].

The simulator's thread must step on time while the callbacks of all nodes run. With Python's default
of 5 ms and a controller that occasionally computes for 4 ms, 1 % of the steps were 4 ms late.
Processes with a single node keep the default. There, a program may use rclpy's
MultiThreadedExecutor, which destroys entities while waiting for them: with 0.1 ms, one shutdown in
seven failed.
"""
OWN_CONTEXT = "; in a composed process, spin_obelisk creates the ROS context and spins the nodes"


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """One node's program."""

    node: str
    """The node's full name, `/ns/name`."""
    module: str
    function: str | None
    """Called without arguments, like a console script; None runs the module as a program."""
    arguments: tuple[str, ...]
    """The command line without the program's name."""

    def __str__(self) -> str:
        return f"{self.module}:{self.function}()" if self.function else f"python -m {self.module}"

    def run(self) -> None:
        """Run the program to its end, as in its own process.

        Raises:
            SystemExit: the program ended, with its exit code.
            BaseException: any exception raised by the program.
        """
        with self.command_line():
            if self.function is None:
                runpy.run_module(self.module, run_name="__main__", alter_sys=True)
                sys.exit(0)
            sys.exit(attrgetter(self.function)(import_module(self.module))())

    @contextmanager
    def command_line(self) -> Iterator[None]:
        """Set `sys.argv` to this program's command line inside the `with` block."""
        before = sys.argv
        sys.argv = [self.module, *self.arguments]
        try:
            yield
        finally:
            sys.argv = before


def read_programs(path: Path) -> tuple[Program, ...]:
    """Read the programs from the launcher's JSON file.

    Raises:
        OSError: the file cannot be read.
        ValueError, KeyError: the file does not have the launcher's format.
    """
    return tuple(
        Program(
            node=entry["node"],
            module=entry["module"],
            function=entry["function"],
            arguments=tuple(entry["arguments"]),
        )
        for entry in json.loads(path.read_text(encoding="utf-8"))["nodes"]
    )


def logger_name(node: str) -> str:
    """Convert a node's full name to the name of its logger: `/ns/name` -> `ns.name`."""
    return node.strip("/").replace("/", ".")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Failure:
    """Why the process ended, and the node that caused it, if known."""

    node: str | None
    fault: NodeFault

    def __str__(self) -> str:
        sentence = f"{self.fault.where}: {self.fault.text}".partition("\n")[0]
        return f"{self.node}: {sentence}" if self.node else sentence


def run_composed(programs: Sequence[Program]) -> int:
    """Run programs and their nodes until shutdown, and return the exit code.

    On failure, the last line on stderr names the cause: `/node: cause`.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    with ros_process([]) as signals:
        host = _Host(signals)
        host.run(programs)
    if host.failure is None:
        return 0
    sys.stderr.write(f"{host.failure}\n")
    return 1


class _Host:
    """Collects the programs' spin requests, and spins once it has all of them."""

    def __init__(self, signals: ShutdownSignals) -> None:
        self.failure: _Failure | None = None
        self._signals = signals
        self._requests: list[tuple[Program, SpinRequest]] = []

    def run(self, programs: Sequence[Program]) -> None:
        """Run the first program, and the others within its call to `spin_obelisk`."""
        if not programs:
            self._spin()
            return
        program, *others = programs
        requests_before = len(self._requests)

        def take(request: SpinRequest) -> int:
            if len(self._requests) == requests_before:
                self._requests.append((program, request))
                self.run(others)
            return int(self.failure is not None)

        try:
            with spin_requests_served_by(take):
                program.run()
        except SystemExit as exit_request:
            code = exit_request.code
            if len(self._requests) == requests_before:
                cause = "the program ended without calling spin_obelisk"
                self._fail(program, fault_of(cause, str(program)))
            elif code and self.failure is None:
                cause = f"the program ended with exit code {code}"
                self._fail(program, fault_of(cause, str(program)))
        except Exception as error:
            fault = fault_of(error, str(program))
            if "Context.init()" in fault.text:
                fault = replace(fault, text=fault.text + OWN_CONTEXT)
            self._fail(program, fault)

    def _spin(self) -> None:
        with ExitStack() as stack:
            wait_at_gate()
            executor = EventLoopExecutor()
            page = stack.enter_context(open_clock_page())
            stack.callback(executor.shutdown)
            stack.enter_context(simulated_time_from(page, executor))
            nodes: dict[GuardedLifecycleNode, Program] = {}
            for program, request in self._requests:
                node = self._make(program, request)
                if node is None:
                    for created in nodes:
                        created.destroy_node()
                    return
                nodes[node] = program
            try:
                died = spin_nodes(executor, list(nodes), self._signals)
            except BaseException as error:
                self._fail(_owner(error, nodes), fault_of(error, "a callback"))
                return
            if died is not None:
                self.failure = _Failure(node=nodes[died.node].node, fault=died.fault)

    def _make(self, program: Program, request: SpinRequest) -> GuardedLifecycleNode | None:
        try:
            arguments = ros_arguments_of(request.args)
            set_log_levels(logger_name(program.node), arguments)
            with program.command_line(), node_arguments(arguments):
                return request.make()
        except BaseException as error:
            self._fail(program, fault_of(error, "the node cannot be created"))
            return None

    def _fail(self, program: Program | None, fault: NodeFault) -> None:
        """Log a fault on the node's logger; the first fault becomes the cause of the failure."""
        node = program.node if program else None
        get_logger(logger_name(node or HOST)).error(str(fault).replace("\n", "\n  "))
        if self.failure is None:
            self.failure = _Failure(node=node, fault=fault)


def ros_arguments_of(args: Sequence[str]) -> tuple[str, ...]:
    """Return the ROS arguments of a command line, including `--ros-args`."""
    return tuple(args[args.index(ROS_ARGUMENTS) :]) if ROS_ARGUMENTS in args else ()


def set_log_levels(own: str, arguments: Sequence[str]) -> None:
    """Set log levels from ROS arguments; a level without a logger applies only to `own`."""
    for option, value in pairwise(arguments):
        if option == LOG_LEVEL:
            name, _, level = value.rpartition(":=")
            set_logger_level(name or own, get_logging_severity_from_string(level))


def _owner(error: BaseException, nodes: dict[GuardedLifecycleNode, Program]) -> Program | None:
    """Return the program of the node whose method raised an exception, from the innermost frame."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    programs = {id(node): program for node, program in nodes.items()}
    selves = (id(frame.f_locals.get("self")) for frame in reversed(frames))
    return next((programs[key] for key in selves if key in programs), None)


def main() -> int:
    """Run the nodes until shutdown, and return the exit code."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python -m obelisk_py.core.composition SPEC.json\n")
        return 2
    return run_composed(read_programs(Path(sys.argv[1])))


if __name__ == "__main__":
    sys.exit(main())
