"""How the processes of a plan are started."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from obk_cli.adapters.packages import PackageIndex
from obk_cli.config.environment import Command
from obk_cli.errors import CommandFailedError
from obk_cli.launch.units import Unit, units_of
from obk_cli.plan.plan import Plan
from obk_cli.report.launch import LaunchReport
from obk_cli.running.commands import find_executables, unit_commands
from obk_cli.running.output import Output
from obk_cli.running.run import _commands

from ..plans import node  # noqa: TID252 - shared by folders of tests
from .shown import Shown

CONTROLLER = node("obelisk_control_0", parameters={"a": 1}, env={"GAIN": "2"}, log_level="debug")
PLAN = Plan(name="s", processes=(CONTROLLER,))
UNITS = units_of(PLAN, devices={"onboard"})
COMMAND = Command(arguments=("run",), python_path=(Path("/src"),), found_in="here", module="m")
EXECUTABLES = {CONTROLLER.full_name: COMMAND}


@pytest.mark.parametrize("is_there", [True, False])
def test_parameters_that_the_run_folder_does_not_take_go_to_one_that_goes_at_the_end(
    tmp_path: Path, is_there: bool
) -> None:
    (tmp_path / "params").write_text("a file where the folder would be")
    screen = Shown()
    output = Output(None, screen, LaunchReport((), colour=False, quiet=False), UNITS)
    with ExitStack() as stack:
        folder = tmp_path if is_there else None
        commands = _commands(UNITS, EXECUTABLES, folder, {}, output, stack)
        arguments = commands[CONTROLLER.full_name].arguments
        params = Path(arguments[arguments.index("--params-file") + 1])
        assert '"a": 1' in params.read_text()
    assert not params.exists()
    assert [line.split(":")[0] for line in screen.lines] == ["warning"] * is_there


def test_a_process_gets_its_name_its_level_and_its_environment(tmp_path: Path) -> None:
    variables = {"PYTHONPATH": "/before", "HOME": "/h"}
    command = unit_commands(UNITS, EXECUTABLES, tmp_path, variables)[CONTROLLER.full_name]
    assert command.arguments[:4] == ("run", "--ros-args", "-r", "__node:=obelisk_control_0")
    assert command.arguments[-2:] == ("--log-level", "debug")
    assert command.environment == {"PYTHONPATH": "/src:/before", "HOME": "/h", "GAIN": "2"}


def test_nodes_that_share_a_process_are_one_command(tmp_path: Path) -> None:
    other = node("obelisk_control_1")
    unit = Unit(name="/s/composed", nodes=(node("obelisk_control_0"), other))
    executables = dict.fromkeys(unit.node_names, COMMAND)
    commands = unit_commands((unit,), executables, tmp_path, {})
    assert list(commands) == ["/s/composed"]
    listed = Path(commands["/s/composed"].arguments[-1]).read_text()
    assert "__node:=obelisk_control_0" in listed
    assert "__node:=obelisk_control_1" in listed


def test_a_package_below_a_folder_with_a_colon_is_refused_with_the_reason(tmp_path: Path) -> None:
    package = tmp_path / "a:b" / "src" / "p"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>p</name></package>")
    (package / "setup.cfg").write_text("[options.entry_points]\nconsole_scripts = e = p:main\n")
    packages = PackageIndex(workspaces=(tmp_path / "a:b",), prefixes=())
    with pytest.raises(CommandFailedError) as refused:
        find_executables([node("obelisk_control_0")], packages)
    assert refused.value.message == (
        f"c.yaml:1:1: package `p` is in `{package}`, and no folder on PYTHONPATH can have a colon "
        "in its name"
    )
