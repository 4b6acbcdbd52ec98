"""How several Python nodes are started in one process.

In: the nodes with their commands and ROS arguments. Out: one command, and the file that it reads.
Starts nothing. The process is the run-time library's, known here by its name and its file only.
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.adapters.node_lines import CONSOLE_FORMAT
from obk_cli.adapters.processes import NodeCommand
from obk_cli.config.environment import Command
from obk_cli.emit.write import STATE_MODE, write_text
from obk_cli.plan.plan import Process

__all__ = ["ComposedNode", "composed_command", "is_composable"]

HOST: Final = "obelisk_py.core.composition"
FILE: Final = "composed.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class ComposedNode:
    """A node that is to share a process."""

    node: str
    """Its full name, `/ns/name`."""
    command: Command
    ros_arguments: tuple[str, ...]
    """`--ros-args ...`, as a process of its own would be given."""


def is_composable(process: Process, command: Command) -> bool:
    """Whether a node can share a process with others.

    It is Python that this interpreter runs, it has a life cycle, and it wants no environment of
    its own.
    """
    return (
        process.has_lifecycle
        and not process.env
        and command.module is not None
        and _is_of_this_python(command)
    )


def composed_command(
    nodes: Sequence[ComposedNode], folder: Path, environment: Mapping[str, str]
) -> NodeCommand:
    """The command of the process in which all these nodes run.

    Args:
        nodes: in the order of bring-up; when the process is asked to end, the last goes first.
        folder: takes the file that lists them.
        environment: of a process without nodes.

    Raises:
        OSError: the file cannot be written.
    """
    path = folder / FILE
    # Parameters stand in it, for nobody else.
    told = json.dumps({"nodes": [_entry(node) for node in nodes]}, indent=2)
    write_text(path, told, mode=STATE_MODE)
    return NodeCommand(
        arguments=(sys.executable, "-P", "-m", HOST, str(path)),
        environment={
            **environment,
            **_python_path(nodes, environment),
            # By this one it is told whose a line is.
            "RCUTILS_CONSOLE_OUTPUT_FORMAT": CONSOLE_FORMAT,
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


def _is_of_this_python(command: Command) -> bool:
    """Run by this interpreter, or installed in its environment."""
    program = Path(command.arguments[0])
    return program == Path(sys.executable) or program.is_relative_to(sys.prefix)
