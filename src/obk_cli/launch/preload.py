"""Processes that load their programs while the launch still checks that the stack may run.

Loading ROS, numpy and MuJoCo takes as long as looking for conflicts in the ROS graph. None of
these processes makes a node before the gate (see `obelisk_spec.gate`) opens.
"""

import fcntl
import os
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

from obelisk_spec.runtime_protocol import GATE_VARIABLE
from obk_cli.launch.commands import Executables, is_composable
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import WardenProcesses
from obk_cli.plan.plan import Process

__all__ = ["closed_gate", "early_units", "gate_path", "gate_variables", "held_at_gate"]

NAME: Final = ".gate"


def gate_variables(folder: Path | None) -> Mapping[str, str]:
    """The variable that names a run's gate to its processes."""
    return {} if folder is None else {GATE_VARIABLE: str(gate_path(folder))}


def early_units(
    units: Iterable[Unit], executables: Executables, gated: Set[tuple[str, str]]
) -> tuple[Unit, ...]:
    """The processes that are known to wait at the gate before they make a node.

    Args:
        units: the processes.
        executables: the nodes' programs.
        gated: package and executable of those whose node the run-time library makes.
    """

    def waits(node: Process) -> bool:
        # The library of another Python may know of no gate.
        is_own = is_composable(node, executables[node.full_name])
        return is_own and (node.package, node.executable) in gated

    return tuple(unit for unit in units if all(map(waits, unit.nodes)))


@contextmanager
def held_at_gate(
    folder: Path | None, units: Iterable[Unit], processes: WardenProcesses
) -> Iterator[None]:
    """Start processes; while entered they make no node, nor afterwards if the run is refused.

    If the run's folder takes no gate, nothing is started early.
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
    """While entered, no program of the run that waits at its gate makes a node.

    Raises:
        OSError: the folder takes no file.
    """
    gate = os.open(gate_path(folder), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(gate, fcntl.LOCK_EX)
        yield
    finally:
        os.close(gate)
