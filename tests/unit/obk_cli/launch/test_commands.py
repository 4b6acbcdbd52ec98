"""Command lines for the processes of a plan, with one or several nodes."""

import json
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from obk_cli.config.environment import Command
from obk_cli.errors import CommandFailedError
from obk_cli.launch.commands import (
    ComposedNode,
    composed_command,
    find_executables,
    is_composable,
    unit_commands,
)
from obk_cli.launch.console import Output
from obk_cli.launch.event_lines import LaunchReport
from obk_cli.launch.process_groups import Unit, units_of
from obk_cli.launch.run import _commands
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.workspace.package_index import PackageIndex

from ..plans import node  # noqa: TID252 - shared by folders of tests
from .shown import Shown

CONTROLLER = node("obelisk_control_0", parameters={"a": 1}, env={"GAIN": "2"}, log_level="debug")
PLAN = Plan(name="s", nodes=(CONTROLLER,))
UNITS = units_of(PLAN, devices={"onboard"})
COMMAND = Command(arguments=("run",), python_path=(Path("/src"),), module="m")
EXECUTABLES = {CONTROLLER.full_name: COMMAND}


PACKAGES = PackageIndex(workspaces=(), prefixes=())


@pytest.mark.parametrize("is_there", [True, False])
def test_parameters_go_to_a_temporary_folder_if_the_run_folder_is_read_only(
    tmp_path: Path, is_there: bool
) -> None:
    (tmp_path / "params").write_text("a file where the folder would be")
    screen = Shown()
    output = Output(None, screen, LaunchReport((), colour=False, quiet=False), UNITS)
    with ExitStack() as stack:
        folder = tmp_path if is_there else None
        commands, _ = _commands(UNITS, EXECUTABLES, folder, {}, PACKAGES, output, stack)
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


@pytest.mark.parametrize(
    ("command", "program"),
    [
        ({"arguments": (sys.executable, "-P", "-c", "c"), "module": "m", "function": "f"}, "c"),
        ({"arguments": (f"{sys.prefix}/lib/p/program",), "module": "m"}, "m"),
        ({"arguments": ("/opt/ros/lib/p/program",), "module": "m"}, None),
        ({"arguments": (f"{sys.prefix}/lib/p/native",)}, None),
    ],
)
def test_a_program_of_this_python_is_known_as_its_arguments(
    tmp_path: Path, command: dict[str, str], program: str | None
) -> None:
    executables = {CONTROLLER.full_name: Command(**command)}  # type: ignore[arg-type]
    found = unit_commands(UNITS, executables, tmp_path, {})[CONTROLLER.full_name]
    if program is None:
        assert found.in_python == ()
    else:
        assert found.in_python[:2] == (sys.executable, "-P")
        assert found.in_python[3:5] == (program, "--ros-args")


def test_nodes_that_share_a_process_are_one_command(tmp_path: Path) -> None:
    other = node("obelisk_control_1")
    unit = Unit(name="/s/composed", nodes=(node("obelisk_control_0"), other))
    executables = dict.fromkeys(unit.node_names, COMMAND)
    commands = unit_commands((unit,), executables, tmp_path, {})
    assert list(commands) == ["/s/composed"]
    listed = Path(commands["/s/composed"].arguments[-1]).read_text()
    assert "__node:=obelisk_control_0" in listed
    assert "__node:=obelisk_control_1" in listed


def test_a_package_below_a_folder_with_a_colon_is_rejected_with_the_reason(tmp_path: Path) -> None:
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


PROCESS = node("arm")
COMPOSABLE = Command(
    arguments=(sys.executable, "-c", "..."),
    python_path=(Path("/ws/arm"),),
    module="arm.run",
    function="main",
)
INSTALLED = Command(arguments=(f"{sys.prefix}/lib/arm/run",), module="arm.run")


def member(name: str, command: Command) -> ComposedNode:
    arguments = ("--ros-args", "-r", f"__node:={name}")
    return ComposedNode(node=f"/{name}", command=command, ros_arguments=arguments)


def test_the_file_lists_the_nodes_and_the_command_names_it(tmp_path: Path) -> None:
    nodes = [member("arm", COMPOSABLE), member("leg", INSTALLED)]
    command = composed_command(nodes, tmp_path, {"HOME": "/home/me"})
    path = tmp_path / "composed.json"
    assert command.arguments == (
        *(sys.executable, "-P", "-m", "obelisk_py.core.composition", str(path)),
    )
    assert json.loads(path.read_text())["nodes"] == [
        {
            "node": "/arm",
            "module": "arm.run",
            "function": "main",
            "arguments": ["--ros-args", "-r", "__node:=arm"],
        },
        {
            "node": "/leg",
            "module": "arm.run",
            "function": None,
            "arguments": ["--ros-args", "-r", "__node:=leg"],
        },
    ]
    assert command.environment["HOME"] == "/home/me"


def test_only_its_owner_reads_the_file(tmp_path: Path) -> None:
    composed_command([member("arm", COMPOSABLE)], tmp_path, {})
    assert (tmp_path / "composed.json").stat().st_mode & 0o777 == 0o600


def test_python_finds_the_packages_of_all_nodes_before_the_users(tmp_path: Path) -> None:
    leg = replace(COMPOSABLE, python_path=(Path("/ws/leg"), Path("/ws/arm")))
    nodes = [member("arm", COMPOSABLE), member("leg", leg)]
    command = composed_command(nodes, tmp_path, {"PYTHONPATH": "/mine"})
    assert command.environment["PYTHONPATH"] == "/ws/arm:/ws/leg:/mine"
    assert "PYTHONPATH" not in composed_command([member("a", INSTALLED)], tmp_path, {}).environment


def test_a_folder_that_takes_no_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        composed_command([member("arm", COMPOSABLE)], tmp_path / "file", {})


def test_python_nodes_of_this_environment_share_a_process() -> None:
    assert is_composable(PROCESS, COMPOSABLE)
    assert is_composable(PROCESS, INSTALLED)


@pytest.mark.parametrize(
    ("process", "command"),
    [
        (replace(PROCESS, env={"GAIN": "1"}), COMPOSABLE),
        (replace(PROCESS, has_lifecycle=False), COMPOSABLE),
        (PROCESS, replace(COMPOSABLE, module=None)),
        (PROCESS, replace(INSTALLED, arguments=("/opt/ros/lib/arm/run",))),
    ],
    ids=["environment", "no life cycle", "not Python", "another Python"],
)
def test_others_do_not(process: PlannedNode, command: Command) -> None:
    assert not is_composable(process, command)
