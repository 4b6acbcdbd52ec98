"""Build the commands, environments, parameter files and clock page with which processes start.

Nothing is started here. Nodes in one process run in the runtime library's host program, of which
this module knows only the name and file.
"""

import fcntl
import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from obelisk_spec.control_socket import RUN_FOLDER_VARIABLE
from obelisk_spec.runtime_protocol import (
    CLOCK_PAGE,
    CLOCK_VARIABLE,
    GATE_VARIABLE,
    LOCAL_TRANSPORT_OFF,
    LOCAL_TRANSPORT_VARIABLE,
    SOCKETS_FOLDER,
    ClockDescriptors,
    clock_page_bytes,
)
from obelisk_spec.suggestions import did_you_mean
from obk_cli.config.environment import Command, ExecutableMissing
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.errors import CommandFailedError
from obk_cli.files import STATE_MODE, write_text
from obk_cli.launch.options import is_only_clock
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import NodeCommand, WardenProcesses
from obk_cli.launch.warden_client import shareable
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.workspace.package_index import PackageIndex

__all__ = [
    "ComposedNode",
    "Executables",
    "closed_gate",
    "composable",
    "composed_command",
    "control_variables",
    "early_units",
    "find_executables",
    "gate_path",
    "gate_variables",
    "held_at_gate",
    "is_composable",
    "ros_arguments",
    "socket_folder",
    "unit_commands",
    "with_clock_page",
]

_CONSOLE_FORMAT: Final = "[{severity}] [{time}] [{name}]: {message}"
"""Value of RCUTILS_CONSOLE_OUTPUT_FORMAT: rcutils' default, which a user may have changed."""

HOST: Final = "obelisk_py.core.composition"
FILE: Final = "composed.json"

Executables = Mapping[str, Command]
"""Full name of a node -> command that starts its program."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    """A node whose command is being built."""

    planned: PlannedNode
    command: Command
    params: Path


def find_executables(nodes: Iterable[PlannedNode], packages: PackageIndex) -> Executables:
    """Find the programs of nodes.

    Raises:
        CommandFailedError: a program is missing, or cannot be started from its folder.
    """
    return {node.full_name: _executable(node, packages) for node in nodes}


def composable(nodes: Iterable[PlannedNode], executables: Executables) -> frozenset[str]:
    """Full names of the nodes that can share a process."""
    return frozenset(
        node.full_name for node in nodes if is_composable(node, executables[node.full_name])
    )


def unit_commands(
    units: Iterable[Unit],
    executables: Executables,
    folder: Path,
    environment: Mapping[str, str],
) -> Mapping[str, NodeCommand]:
    """The command of each process, by the name of its unit.

    Args:
        units: the processes.
        executables: the nodes' programs.
        folder: where to write the parameter files, `params/<node>.yaml`.
        environment: the environment that all processes have in common.

    Raises:
        OSError: a file cannot be written.
    """
    commands = {}
    for unit in units:
        nodes = [
            _Node(
                planned=node,
                command=executables[node.full_name],
                params=_write_params(node, folder),
            )
            for node in unit.nodes
        ]
        shared = len(nodes) > 1
        commands[unit.name] = (
            _shared(nodes, folder, environment) if shared else _alone(nodes[0], environment)
        )
    return commands


def _executable(node: PlannedNode, packages: PackageIndex) -> Command:
    found = packages.find_executable(node.package, node.executable)
    if isinstance(found, ExecutableMissing):
        if not found.package_found:
            message = f"{node.origin}: package `{node.package}` was not found"
            raise CommandFailedError(message, help=found.looked)
        raise CommandFailedError(
            f"{node.origin}: package `{node.package}` has no executable `{node.executable}`",
            help=did_you_mean(node.executable, found.available) or "it has no executables",
        )
    for folder in found.python_path:
        if os.pathsep in str(folder):
            raise CommandFailedError(
                f"{node.origin}: package `{node.package}` is in `{folder}`, and no folder "
                "on PYTHONPATH can have a colon in its name",
                help="rename the folder",
            )
    return found


def _write_params(node: PlannedNode, folder: Path) -> Path:
    path = folder / "params" / params_file_name(node)
    write_text(path, emit_params((node,)), mode=STATE_MODE)
    return path


def _alone(node: _Node, environment: Mapping[str, str]) -> NodeCommand:
    options = tuple(ros_arguments(node.planned, node.params))
    program = _in_python(node.command)
    return NodeCommand(
        arguments=(*node.command.arguments, *options),
        environment=_environment(node, environment),
        in_python=(*program, *options) if program else (),
    )


def _in_python(command: Command) -> tuple[str, ...]:
    """The arguments with which this Python runs a program; empty if it cannot."""
    if not command.is_of_this_python:
        return ()
    if command.function is not None or command.module is None:
        return command.arguments
    return (sys.executable, "-P", "-m", command.module)


def _shared(nodes: Iterable[_Node], folder: Path, environment: Mapping[str, str]) -> NodeCommand:
    return composed_command(
        [
            ComposedNode(
                node=node.planned.full_name,
                command=node.command,
                ros_arguments=tuple(ros_arguments(node.planned, node.params)),
            )
            for node in nodes
        ],
        folder,
        environment,
    )


def ros_arguments(node: PlannedNode, params: Path) -> Iterator[str]:
    """The arguments of a node's program: name, namespace, remappings, parameters, log level."""
    yield from ("--ros-args", "-r", f"__node:={node.node}")
    if node.namespace not in ("", "/"):
        yield from ("-r", f"__ns:={node.namespace}")
    for source, target in node.remappings:
        yield from ("-r", f"{source}:={target}")
    yield from ("--params-file", str(params))
    if node.log_level:
        yield from ("--log-level", node.log_level)


def _environment(node: _Node, variables: Mapping[str, str]) -> dict[str, str]:
    merged = {**variables, **node.planned.env}
    if node.command.python_path:
        inherited = merged.get("PYTHONPATH")
        parts = [*map(str, node.command.python_path), *([inherited] if inherited else [])]
        merged["PYTHONPATH"] = ":".join(parts)
    return merged


@dataclass(frozen=True, slots=True, kw_only=True)
class ComposedNode:
    """A node that shares a process."""

    node: str
    """The node's full name, `/ns/name`."""
    command: Command
    ros_arguments: tuple[str, ...]
    """`--ros-args ...`, as for a process of its own."""


def is_composable(node: PlannedNode, command: Command) -> bool:
    """Whether a node can share a process with others.

    It can if it is Python that this interpreter runs, has a lifecycle, and sets no environment
    variables.
    """
    return node.has_lifecycle and not node.env and command.is_of_this_python


def composed_command(
    nodes: Sequence[ComposedNode], folder: Path, environment: Mapping[str, str]
) -> NodeCommand:
    """The command of the process that runs all these nodes.

    Args:
        nodes: in the order of bring-up; at shutdown, the process destroys the last one first.
        folder: where to write the file that lists the nodes.
        environment: the environment without the nodes' own variables.

    Raises:
        OSError: the file cannot be written.
    """
    path = folder / FILE
    # The file holds parameters, which other users must not read.
    listing = json.dumps({"nodes": [_entry(node) for node in nodes]}, indent=2)
    write_text(path, listing, mode=STATE_MODE)
    return NodeCommand(
        arguments=(sys.executable, "-P", "-m", HOST, str(path)),
        environment={
            **environment,
            **_python_path(nodes, environment),
            # `NodeLines` knows the node of a line by this format.
            "RCUTILS_CONSOLE_OUTPUT_FORMAT": _CONSOLE_FORMAT,
        },
    )


def _entry(node: ComposedNode) -> Mapping[str, object]:
    return {
        "node": node.node,
        "module": node.command.module,
        "function": node.command.function,
        "arguments": node.ros_arguments,
    }


def _python_path(
    nodes: Iterable[ComposedNode], environment: Mapping[str, str]
) -> Mapping[str, str]:
    folders = dict.fromkeys(str(path) for node in nodes for path in node.command.python_path)
    inherited = environment.get("PYTHONPATH")
    parts = [*folders, *([inherited] if inherited else [])]
    return {"PYTHONPATH": ":".join(parts)} if parts else {}


NAME: Final = ".gate"


def gate_variables(folder: Path | None) -> Mapping[str, str]:
    """The variable that names a run's gate to its processes."""
    return {} if folder is None else {GATE_VARIABLE: str(gate_path(folder))}


def control_variables(folder: Path | None) -> Mapping[str, str]:
    """The variable that names a run's folder to its processes, for reports to the launcher."""
    return {} if folder is None else {RUN_FOLDER_VARIABLE: str(folder)}


def early_units(
    units: Iterable[Unit], executables: Executables, gated: Set[tuple[str, str]]
) -> tuple[Unit, ...]:
    """The processes that are known to wait at the gate before they create a node.

    Simulators come first, because they have the most to load before that.

    Args:
        units: the processes.
        executables: the nodes' programs.
        gated: package and executable of the programs that wait at the gate.
    """

    def waits(node: PlannedNode) -> bool:
        # The library of another Python may not support the gate.
        is_own = is_composable(node, executables[node.full_name])
        return is_own and (node.package, node.executable) in gated

    early = (unit for unit in units if all(map(waits, unit.nodes)))
    return tuple(sorted(early, key=lambda unit: not any(node.model for node in unit.nodes)))


@contextmanager
def held_at_gate(
    folder: Path | None, units: Iterable[Unit], processes: WardenProcesses
) -> Iterator[None]:
    """Start processes that create nodes only after the `with` block; none if the run is rejected.

    If the run's folder cannot hold a gate, nothing is started early.
    """
    with ExitStack() as gate:
        if folder is not None and _is_closed(folder, gate):
            for unit in units:
                processes.start_early(unit)
        try:
            yield
        except BaseException:
            processes.end()
            raise


def _is_closed(folder: Path, gate: ExitStack) -> bool:
    try:
        gate.enter_context(closed_gate(folder))
    except OSError:
        return False
    return True


def gate_path(folder: Path) -> Path:
    """The gate of a run, in its folder."""
    return folder / NAME


@contextmanager
def closed_gate(folder: Path) -> Iterator[None]:
    """Inside the `with` block, programs of the run that wait at its gate create no node.

    Raises:
        OSError: the folder is not writable.
    """
    gate = os.open(gate_path(folder), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(gate, fcntl.LOCK_EX)
        yield
    finally:
        os.close(gate)


@contextmanager
def socket_folder(
    folder: Path | None, environment: Mapping[str, str]
) -> Iterator[Mapping[str, str]]:
    """The variable that names a new folder for the sockets of a run; removed on exit.

    The mapping is empty if the user has turned the local transport off, or if the run has no
    folder. All messages between processes then use DDS.
    """
    if folder is None or environment.get(LOCAL_TRANSPORT_VARIABLE) == LOCAL_TRANSPORT_OFF:
        yield {LOCAL_TRANSPORT_VARIABLE: LOCAL_TRANSPORT_OFF}
        return
    sockets = folder / SOCKETS_FOLDER
    try:
        sockets.mkdir(mode=0o700)
    except OSError:
        yield {LOCAL_TRANSPORT_VARIABLE: LOCAL_TRANSPORT_OFF}
        return
    try:
        yield {LOCAL_TRANSPORT_VARIABLE: str(sockets)}
    finally:
        shutil.rmtree(sockets, ignore_errors=True)


@contextmanager
def with_clock_page(
    plan: Plan, units: Sequence[Unit], commands: Mapping[str, NodeCommand]
) -> Iterator[tuple[Mapping[str, NodeCommand], ClockDescriptors | None]]:
    """Add a clock page to the units' commands, if our simulator runs here as the only clock.

    Otherwise processes use `/clock`, and the commands are unchanged. The page is a memfd, and an
    eventfd wakes each process; processes inherit all of them. None of them has a name in the file
    system, so nothing is left behind however the launch ends. The launcher has the last slot.

    Args:
        plan: the whole stack.
        units: the processes to run here.
        commands: their commands, by the name of the unit.
    """
    if not is_only_clock(plan, [node for unit in units for node in unit.nodes]):
        yield commands, None
        return
    page = shareable(os.memfd_create(CLOCK_PAGE))
    places = len(units) + 1
    os.ftruncate(page, clock_page_bytes(places))
    wakes = tuple(shareable(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)) for _ in range(places))
    own_end, *ends = (
        ClockDescriptors(page=page, own=own, wakes=wakes)
        for own in (len(units), *range(len(units)))
    )
    try:
        yield (
            {
                unit.name: _inheriting(commands[unit.name], end)
                for unit, end in zip(units, ends, strict=True)
            },
            own_end,
        )
    finally:
        for fd in (page, *wakes):
            os.close(fd)


def _inheriting(command: NodeCommand, descriptors: ClockDescriptors) -> NodeCommand:
    return replace(
        command,
        environment={**command.environment, CLOCK_VARIABLE: str(descriptors)},
        inherited=(descriptors.page, *descriptors.wakes),
    )
