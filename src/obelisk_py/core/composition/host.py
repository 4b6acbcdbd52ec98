"""The host of a composed process: runs programs inside one another and spins all their nodes.

Each program is run until it asks for its node to be spun; the next one is run within that request.
The last request makes the nodes and spins them until the end, and then each program goes on after
its own, last one first. So a program's `with open_robot(): spin_obelisk(...)` holds as it does in
a process of its own, and a program or a node that fails is known by its name. No node is made
before every program has come to its request.
"""

import sys
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise

from rclpy.logging import get_logger, get_logging_severity_from_string, set_logger_level

from obelisk_py.core.composition.programs import Program, logger_name
from obelisk_py.core.end_signals import EndSignals
from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.faults import Fault, fault_of
from obelisk_py.core.gate import wait_at_gate
from obelisk_py.core.lifecycle import GuardedLifecycleNode, node_arguments
from obelisk_py.core.spinning import Wanted, ros_process, spin_nodes, spun_by

__all__ = ["run_composed"]

ROS_ARGUMENTS = "--ros-args"
LOG_LEVEL = "--log-level"
HOST = "composed"
"""The logger for what is no node's."""
SWITCH_INTERVAL_S = 1e-4
"""How long one thread may keep the interpreter while another waits for it [s].

The simulator's thread has to step in time beside the callbacks of all nodes. With the usual 5 ms
and a controller that computes for 4 ms now and then, one step in a hundred was 4 ms late. In a
process of one node it stays as it is: rclpy's MultiThreadedExecutor, which a program may ask for,
destroys what it waits for, and with 0.1 ms did so in one end of seven.
"""
OWN_CONTEXT = "; in a composed process the ROS context and the spinning are spin_obelisk's"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Culprit:
    """Why the process ends, and for which node where that is known."""

    node: str | None
    fault: Fault

    def __str__(self) -> str:
        sentence = f"{self.fault.where}: {self.fault.text}".partition("\n")[0]
        return f"{self.node}: {sentence}" if self.node else sentence


def run_composed(programs: Sequence[Program]) -> int:
    """Run programs and their nodes until the end; the exit code.

    The last thing written to the standard error is whose fault the end was, `/node: what`.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    with ros_process([]) as signals:
        host = _Host(signals)
        host.run(programs)
    if host.culprit is None:
        return 0
    sys.stderr.write(f"{host.culprit}\n")
    return 1


class _Host:
    """Holds what the programs asked for until all have."""

    def __init__(self, signals: EndSignals) -> None:
        self.culprit: _Culprit | None = None
        self._signals = signals
        self._asked: list[tuple[Program, Wanted]] = []

    def run(self, programs: Sequence[Program]) -> None:
        """Run the first program and, when it asks for its node to be spun, the others."""
        if not programs:
            self._spin()
            return
        program, *others = programs
        asked_before = len(self._asked)

        def take(wanted: Wanted) -> int:
            if len(self._asked) == asked_before:
                self._asked.append((program, wanted))
                self.run(others)
            return int(self.culprit is not None)

        try:
            with spun_by(take):
                program.run()
        except SystemExit as end:
            if len(self._asked) == asked_before:
                self._blame(
                    program, fault_of("it ended without a call of spin_obelisk", str(program))
                )
            elif end.code and self.culprit is None:
                self._blame(
                    program, fault_of(f"it ended with the exit code {end.code}", str(program))
                )
        except Exception as error:
            fault = fault_of(error, str(program))
            if "Context.init()" in fault.text:
                fault = replace(fault, text=fault.text + OWN_CONTEXT)
            self._blame(program, fault)

    def _spin(self) -> None:
        wait_at_gate()
        executor = EventLoopExecutor()
        with ExitStack() as stack:
            stack.callback(executor.shutdown)
            nodes: dict[GuardedLifecycleNode, Program] = {}
            for program, wanted in self._asked:
                node = self._make(program, wanted)
                if node is None:
                    for made in nodes:
                        made.destroy_node()
                    return
                nodes[node] = program
            try:
                died = spin_nodes(executor, list(nodes), self._signals)
            except BaseException as error:
                self._blame(_owner(error, nodes), fault_of(error, "a callback"))
                return
            if died is not None:
                self.culprit = _Culprit(node=nodes[died.node].node, fault=died.fault)

    def _make(self, program: Program, wanted: Wanted) -> GuardedLifecycleNode | None:
        try:
            arguments = _ros_arguments(wanted.args)
            _set_log_levels(logger_name(program.node), arguments)
            with program.command_line(), node_arguments(arguments):
                return wanted.make()
        except BaseException as error:
            self._blame(program, fault_of(error, "the node cannot be made"))
            return None

    def _blame(self, program: Program | None, fault: Fault) -> None:
        """Tell on the node's own log; the first one is the culprit."""
        node = program.node if program else None
        get_logger(logger_name(node or HOST)).error(str(fault).replace("\n", "\n  "))
        if self.culprit is None:
            self.culprit = _Culprit(node=node, fault=fault)


def _ros_arguments(args: Sequence[str]) -> tuple[str, ...]:
    """The part of a command line that is ROS's."""
    return tuple(args[args.index(ROS_ARGUMENTS) :]) if ROS_ARGUMENTS in args else ()


def _set_log_levels(own: str, arguments: Sequence[str]) -> None:
    """Set levels as the ROS arguments of a process do, a bare one for the node's loggers only."""
    for option, value in pairwise(arguments):
        if option == LOG_LEVEL:
            name, _, level = value.rpartition(":=")
            set_logger_level(name or own, get_logging_severity_from_string(level))


def _owner(error: BaseException, nodes: dict[GuardedLifecycleNode, Program]) -> Program | None:
    """The program of the innermost node in whose method an exception came up."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    known = {id(node): program for node, program in nodes.items()}
    selves = (id(frame.f_locals.get("self")) for frame in reversed(frames))
    return next((known[it] for it in selves if it in known), None)
