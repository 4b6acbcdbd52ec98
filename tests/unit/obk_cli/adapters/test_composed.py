"""The command and the file of a process that several nodes share."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from obk_cli.adapters.composed import ComposedNode, composed_command, is_composable
from obk_cli.config.environment import Command
from obk_cli.plan.plan import Process

from ..plans import node  # noqa: TID252 - shared by folders of tests

PROCESS = node("arm")
COMMAND = Command(
    arguments=(sys.executable, "-c", "..."),
    found_in="the sources",
    python_path=(Path("/ws/arm"),),
    module="arm.run",
    function="main",
)
INSTALLED = Command(
    arguments=(f"{sys.prefix}/lib/arm/run",), found_in="the prefix", module="arm.run"
)


def member(name: str, command: Command) -> ComposedNode:
    arguments = ("--ros-args", "-r", f"__node:={name}")
    return ComposedNode(node=f"/{name}", command=command, ros_arguments=arguments)


def test_the_file_lists_the_nodes_and_the_command_names_it(tmp_path: Path) -> None:
    nodes = [member("arm", COMMAND), member("leg", INSTALLED)]
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
    composed_command([member("arm", COMMAND)], tmp_path, {})
    assert (tmp_path / "composed.json").stat().st_mode & 0o777 == 0o600


def test_python_finds_the_packages_of_all_nodes_before_the_users_own(tmp_path: Path) -> None:
    leg = replace(COMMAND, python_path=(Path("/ws/leg"), Path("/ws/arm")))
    nodes = [member("arm", COMMAND), member("leg", leg)]
    command = composed_command(nodes, tmp_path, {"PYTHONPATH": "/mine"})
    assert command.environment["PYTHONPATH"] == "/ws/arm:/ws/leg:/mine"
    assert "PYTHONPATH" not in composed_command([member("a", INSTALLED)], tmp_path, {}).environment


def test_a_folder_that_takes_no_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        composed_command([member("arm", COMMAND)], tmp_path / "file", {})


def test_python_nodes_of_this_environment_share_a_process() -> None:
    assert is_composable(PROCESS, COMMAND)
    assert is_composable(PROCESS, INSTALLED)


@pytest.mark.parametrize(
    ("process", "command"),
    [
        (replace(PROCESS, env={"GAIN": "1"}), COMMAND),
        (replace(PROCESS, has_lifecycle=False), COMMAND),
        (PROCESS, replace(COMMAND, module=None)),
        (PROCESS, replace(INSTALLED, arguments=("/opt/ros/lib/arm/run",))),
    ],
    ids=["environment", "no life cycle", "not Python", "another Python"],
)
def test_others_do_not(process: Process, command: Command) -> None:
    assert not is_composable(process, command)
