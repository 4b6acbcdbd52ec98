"""Run the programs of several nodes in this process: `python -m obelisk_py.core.composition FILE`.

In: the JSON file that the launcher wrote, `{"nodes": [{"node", "module", "function", "arguments"},
...]}`. Programs run inside one another: each runs until it calls `spin_obelisk`; the next one runs
within that call. The last call makes the nodes and spins them until the end; then the programs
continue, the last one first. So a program's `with open_robot(): spin_obelisk(...)` works as in a
process of its own, and a program or node that fails is known by its name. No node is made before
every program has made its call.
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
    wait_at_startup_barrier,
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
"""The logger of messages that belong to no node."""
SWITCH_INTERVAL_S = 1e-4
"""How long one thread may keep the interpreter while another waits for it [s].

The simulator's thread has to step in time beside the callbacks of all nodes. With the usual 5 ms
and a controller that computes for 4 ms now and then, one step in a hundred was 4 ms late. In a
process of one node it stays as it is: rclpy's MultiThreadedExecutor, which a program may ask for,
destroys what it waits for, and with 0.1 ms did so in one end of seven.
"""
OWN_CONTEXT = "; in a composed process the ROS context and the spinning are spin_obelisk's"


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """One node's program."""

    node: str
    """The node's full name, `/ns/name`."""
    module: str
    function: str | None
    """Called without arguments, as a console script is; None runs the module as a program."""
    arguments: tuple[str, ...]
    """The command line without the program's name."""

    def __str__(self) -> str:
        return f"{self.module}:{self.function}()" if self.function else f"python -m {self.module}"

    def run(self) -> None:
        """Run the program to its end, as a process of its own would.

        Raises:
            SystemExit: with its exit code.
            BaseException: any exception of the program.
        """
        with self.command_line():
            if self.function is None:
                runpy.run_module(self.module, run_name="__main__", alter_sys=True)
                sys.exit(0)
            sys.exit(attrgetter(self.function)(import_module(self.module))())

    @contextmanager
    def command_line(self) -> Iterator[None]:
        """While entered, `sys.argv` is this program's."""
        before = sys.argv
        sys.argv = [self.module, *self.arguments]
        try:
            yield
        finally:
            sys.argv = before


def read_programs(path: Path) -> tuple[Program, ...]:
    """The programs that a file lists.

    Raises:
        OSError: the file cannot be read.
        ValueError, KeyError: it was not written by the launcher.
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
    """The logger of a node, by its full name: `/ns/name` -> `ns.name`."""
    return node.strip("/").replace("/", ".")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Failure:
    """The cause of the end of the process, and its node, if known."""

    node: str | None
    fault: NodeFault

    def __str__(self) -> str:
        sentence = f"{self.fault.where}: {self.fault.text}".partition("\n")[0]
        return f"{self.node}: {sentence}" if self.node else sentence


def run_composed(programs: Sequence[Program]) -> int:
    """Run programs and their nodes until the end; the exit code.

    If it failed, the last line on the standard error names the cause, `/node: what`.
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
    """Collects the requests of the programs, and spins when it has all."""

    def __init__(self, signals: ShutdownSignals) -> None:
        self.failure: _Failure | None = None
        self._signals = signals
        self._requests: list[tuple[Program, SpinRequest]] = []

    def run(self, programs: Sequence[Program]) -> None:
        """Run the first program and, within its call of `spin_obelisk`, the others."""
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
        except SystemExit as end:
            if len(self._requests) == requests_before:
                self._fail(
                    program, fault_of("it ended without a call of spin_obelisk", str(program))
                )
            elif end.code and self.failure is None:
                self._fail(
                    program, fault_of(f"it ended with the exit code {end.code}", str(program))
                )
        except Exception as error:
            fault = fault_of(error, str(program))
            if "Context.init()" in fault.text:
                fault = replace(fault, text=fault.text + OWN_CONTEXT)
            self._fail(program, fault)

    def _spin(self) -> None:
        wait_at_startup_barrier()
        executor = EventLoopExecutor()
        with ExitStack() as stack:
            page = stack.enter_context(open_clock_page())
            stack.callback(executor.shutdown)
            stack.enter_context(simulated_time_from(page, executor))
            nodes: dict[GuardedLifecycleNode, Program] = {}
            for program, request in self._requests:
                node = self._make(program, request)
                if node is None:
                    for made in nodes:
                        made.destroy_node()
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
            self._fail(program, fault_of(error, "the node cannot be made"))
            return None

    def _fail(self, program: Program | None, fault: NodeFault) -> None:
        """Log a fault on the node's own logger; the first one is the cause of the end."""
        node = program.node if program else None
        get_logger(logger_name(node or HOST)).error(str(fault).replace("\n", "\n  "))
        if self.failure is None:
            self.failure = _Failure(node=node, fault=fault)


def ros_arguments_of(args: Sequence[str]) -> tuple[str, ...]:
    """The ROS arguments of a command line."""
    return tuple(args[args.index(ROS_ARGUMENTS) :]) if ROS_ARGUMENTS in args else ()


def set_log_levels(own: str, arguments: Sequence[str]) -> None:
    """Set levels as the ROS arguments of a process do, a bare one for the node's loggers only."""
    for option, value in pairwise(arguments):
        if option == LOG_LEVEL:
            name, _, level = value.rpartition(":=")
            set_logger_level(name or own, get_logging_severity_from_string(level))


def _owner(error: BaseException, nodes: dict[GuardedLifecycleNode, Program]) -> Program | None:
    """The program of the innermost node in whose method an exception was raised."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    known = {id(node): program for node, program in nodes.items()}
    selves = (id(frame.f_locals.get("self")) for frame in reversed(frames))
    return next((known[it] for it in selves if it in known), None)


def main() -> int:
    """Run until the nodes are asked to end; the exit code."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python -m obelisk_py.core.composition SPEC.json\n")
        return 2
    return run_composed(read_programs(Path(sys.argv[1])))


if __name__ == "__main__":
    sys.exit(main())
