"""Processes that load their programs while it is still made sure that the stack may run.

What loading takes, the imports of ROS, numpy and MuJoCo, is as long as looking for others in the
ROS graph. None of these processes makes a node before the gate opens, so nobody sees them earlier.
"""

from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import ExitStack, contextmanager
from pathlib import Path

from obelisk_spec.gate import GATE_VARIABLE
from obk_cli.adapters.composed import is_composable
from obk_cli.adapters.gate import closed_gate, gate_path
from obk_cli.adapters.processes import WardenProcesses
from obk_cli.launch.units import Unit
from obk_cli.plan.plan import Process
from obk_cli.running.commands import Executables

__all__ = ["early_units", "gate_variables", "held_at_gate"]


def gate_variables(folder: Path | None) -> Mapping[str, str]:
    """The variable that tells the processes of a run of its gate."""
    return {} if folder is None else {GATE_VARIABLE: str(gate_path(folder))}


def early_units(
    units: Iterable[Unit], executables: Executables, spun: Set[tuple[str, str]]
) -> tuple[Unit, ...]:
    """The processes that are known to wait at the gate before they make a node.

    Args:
        units: the processes.
        executables: the nodes' programs.
        spun: package and executable of those that have the run-time library make their node.
    """

    def waits(node: Process) -> bool:
        # The library of another Python may know of no gate.
        is_own = is_composable(node, executables[node.full_name])
        return is_own and (node.package, node.executable) in spun

    return tuple(unit for unit in units if all(map(waits, unit.nodes)))


@contextmanager
def held_at_gate(
    folder: Path | None, units: Iterable[Unit], processes: WardenProcesses
) -> Iterator[None]:
    """Start processes; while entered they make no node, nor afterwards if the run is refused.

    Where the run's folder takes no gate nothing is started: it comes with the others.
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
