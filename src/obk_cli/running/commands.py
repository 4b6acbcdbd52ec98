"""How the processes of a plan are started: commands, environments, parameter files."""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from obelisk_spec.suggestions import did_you_mean
from obk_cli.adapters.composed import ComposedNode, composed_command, is_composable
from obk_cli.adapters.packages import PackageIndex
from obk_cli.adapters.processes import NodeCommand
from obk_cli.config.environment import Command, ExecutableMissing
from obk_cli.emit.params import emit_params, params_file_name
from obk_cli.emit.write import STATE_MODE, write_text
from obk_cli.errors import CommandFailedError
from obk_cli.launch.units import Unit
from obk_cli.plan.plan import Process

__all__ = ["Executables", "composable", "find_executables", "unit_commands"]

Executables = Mapping[str, Command]
"""Full name of a node -> how its program is started."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    """One node on its way to a command."""

    process: Process
    command: Command
    params: Path


def find_executables(nodes: Iterable[Process], packages: PackageIndex) -> Executables:
    """The programs of nodes.

    Raises:
        CommandFailedError: one is missing, or cannot be started from where it is.
    """
    return {node.full_name: _executable(node, packages) for node in nodes}


def composable(nodes: Iterable[Process], executables: Executables) -> frozenset[str]:
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
    """The command of each process, by the unit's name.

    Args:
        units: the processes.
        executables: the nodes' programs.
        folder: takes the parameter files, `params/<node>.yaml`.
        environment: of all of them.

    Raises:
        OSError: a file cannot be written.
    """
    commands = {}
    for unit in units:
        nodes = [
            _Node(
                process=node,
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


def _executable(process: Process, packages: PackageIndex) -> Command:
    found = packages.find_executable(process.package, process.executable)
    if isinstance(found, ExecutableMissing):
        if not found.package_found:
            message = f"{process.origin}: package `{process.package}` is not found"
            raise CommandFailedError(message, help=found.looked)
        raise CommandFailedError(
            f"{process.origin}: package `{process.package}` has no executable "
            f"`{process.executable}`",
            help=did_you_mean(process.executable, found.available) or "it has none at all",
        )
    for folder in found.python_path:
        if os.pathsep in str(folder):
            raise CommandFailedError(
                f"{process.origin}: package `{process.package}` is in `{folder}`, and no folder "
                "on PYTHONPATH can have a colon in its name",
                help="rename the folder",
            )
    return found


def _write_params(node: Process, folder: Path) -> Path:
    path = folder / "params" / params_file_name(node)
    write_text(path, emit_params((node,)), mode=STATE_MODE)
    return path


def _alone(node: _Node, environment: Mapping[str, str]) -> NodeCommand:
    return NodeCommand(
        arguments=(*node.command.arguments, *_ros_arguments(node)),
        environment=_environment(node, environment),
    )


def _shared(nodes: Iterable[_Node], folder: Path, environment: Mapping[str, str]) -> NodeCommand:
    return composed_command(
        [
            ComposedNode(
                node=node.process.full_name,
                command=node.command,
                ros_arguments=tuple(_ros_arguments(node)),
            )
            for node in nodes
        ],
        folder,
        environment,
    )


def _ros_arguments(node: _Node) -> Iterator[str]:
    process = node.process
    yield from ("--ros-args", "-r", f"__node:={process.node}")
    if process.namespace not in ("", "/"):
        yield from ("-r", f"__ns:={process.namespace}")
    for source, target in process.remappings:
        yield from ("-r", f"{source}:={target}")
    yield from ("--params-file", str(node.params))
    if process.log_level:
        yield from ("--log-level", process.log_level)


def _environment(node: _Node, variables: Mapping[str, str]) -> dict[str, str]:
    merged = {**variables, **node.process.env}
    if node.command.python_path:
        inherited = merged.get("PYTHONPATH")
        parts = [*map(str, node.command.python_path), *([inherited] if inherited else [])]
        merged["PYTHONPATH"] = ":".join(parts)
    return merged
