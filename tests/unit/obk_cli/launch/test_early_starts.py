"""The processes that load their programs early, and what holds them."""

import fcntl
import sys
from pathlib import Path

import pytest

from obk_cli.config.environment import Command
from obk_cli.errors import CommandFailedError
from obk_cli.launch.commands import early_units, gate_path, gate_variables, held_at_gate
from obk_cli.launch.process_groups import Unit, units_of
from obk_cli.plan.plan import Plan, PlannedNode

from ..plans import node  # noqa: TID252 - shared by folders of tests


def command(program: str = sys.executable) -> Command:
    return Command(arguments=(program,), module="m")


def early(*nodes: PlannedNode, program: str = sys.executable, together: bool = False) -> list[str]:
    names = [node.full_name for node in nodes]
    plan = Plan(name="s", nodes=nodes)
    units = units_of(plan, devices={"onboard"}, together=names if together else [])
    executables = dict.fromkeys(names, command(program))
    return [unit.name for unit in early_units(units, executables, {("p", "e")})]


def test_a_program_whose_node_the_library_creates_is_early() -> None:
    assert early(node("a"), node("b", executable="of_another_kind")) == ["/a"]


@pytest.mark.parametrize(
    "late",
    [node("a", env={"A": "1"}), node("a", has_lifecycle=False)],
    ids=["env", "no life cycle"],
)
def test_modules_of_another_library_are_not_preloaded(late: PlannedNode) -> None:
    assert not early(late)
    assert not early(node("a"), program="/usr/bin/python3")


def test_nodes_in_one_process_are_early_when_all_of_them_wait() -> None:
    assert early(node("a"), node("b"), together=True) == ["/s/composed"]
    assert not early(node("a"), node("b", executable="of_another_kind"), together=True)


def test_a_simulator_comes_first() -> None:
    assert early(node("a"), node("b"), node("robot", model="r.xml")) == ["/robot", "/a", "/b"]


class Started:
    """The gate for the processes."""

    def __init__(self, folder: Path) -> None:
        self.names: list[str] = []
        self.ended_held: list[bool] = []
        """For each process that ended, whether the gate was closed at that time."""
        self._folder = folder

    def start_early(self, unit: Unit) -> None:
        self.names.append(unit.name)

    def end(self) -> None:
        self.ended_held.append(is_closed(self._folder))


def is_closed(folder: Path) -> bool:
    with gate_path(folder).open() as gate:
        try:
            fcntl.flock(gate, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def test_without_a_gate_nothing_starts_early(tmp_path: Path) -> None:
    units = units_of(Plan(name="s", nodes=(node("a"),)), devices={"onboard"})
    started = Started(tmp_path)
    gate_path(tmp_path).mkdir()
    for folder in (None, tmp_path):
        with held_at_gate(folder, units, started):  # type: ignore[arg-type]
            assert not started.names
    gate_path(tmp_path).rmdir()
    with held_at_gate(tmp_path, units, started):  # type: ignore[arg-type]
        assert started.names == ["/a"]
    assert not started.ended_held
    assert gate_variables(None) == {}


def test_no_process_of_a_rejected_run_passes_the_gate(tmp_path: Path) -> None:
    started = Started(tmp_path)
    with (
        pytest.raises(CommandFailedError, match="another node"),
        held_at_gate(tmp_path, (), started),  # type: ignore[arg-type]
    ):
        raise CommandFailedError("another node moves the robot")
    assert started.ended_held == [True]
    assert not is_closed(tmp_path)
