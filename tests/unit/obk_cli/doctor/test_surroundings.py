"""Checks of the workspace, search paths and running stacks, in fake worlds."""

from dataclasses import replace

from obk_cli.doctor.installation import PathFacts, judge_paths
from obk_cli.doctor.workspace import (
    RunningStack,
    StackFacts,
    WorkspaceFacts,
    judge_stacks,
    judge_workspace,
)

from .findings import severities, the_one

WORKSPACE = WorkspaceFacts(folder="/ws", packages=("a", "b"), broken=(), doubled=(), unbuilt=())
PATHS = PathFacts(
    obk_programs=("/venv/bin/obk",),
    this_obk="/venv/bin/obk",
    ros2_program=None,
    distribution="jazzy",
    python_path=(),
    python_path_with_rclpy=(),
    has_wheels=True,
    python_version="3.12",
    conda_prefix=None,
    prefix="/venv",
    libraries_with_rcl=(),
)


def test_a_healthy_world_gives_no_findings() -> None:
    nothing = StackFacts(running=(), orphans=())
    found = [*judge_workspace(WORKSPACE), *judge_paths(PATHS), *judge_stacks(nothing)]
    assert severities(found) == ["ok", "ok", "ok"]


def test_outside_a_workspace_it_reports_how_to_create_one() -> None:
    found = the_one(judge_workspace(replace(WORKSPACE, folder=None)), "note")
    assert found.fix == "obk init my_robot"


def test_a_package_without_a_name_is_reported() -> None:
    the_one(judge_workspace(replace(WORKSPACE, broken=("/ws/c/package.xml",))), "warning")


def test_two_packages_of_one_name_are_reported() -> None:
    found = the_one(judge_workspace(replace(WORKSPACE, doubled=("a",))), "warning")
    assert found.fix == "grep -rl '<name>a</name>' --include package.xml /ws"


def test_message_packages_to_be_built_are_noted_with_the_command() -> None:
    found = the_one(judge_workspace(replace(WORKSPACE, unbuilt=("b", "a"))), "note")
    assert found.fix == "obk build b a"


def test_message_packages_that_cannot_be_read_are_reported() -> None:
    the_one(judge_workspace(replace(WORKSPACE, fault="a circle")), "warning")


def test_a_shell_that_finds_no_obk_or_another_one_is_reported_the_way() -> None:
    for programs, reported in (
        ((), "finds no `obk`"),
        (("/usr/bin/obk",), "`obk` is /usr/bin/obk"),
    ):
        found = the_one(judge_paths(replace(PATHS, obk_programs=programs)), "note")
        assert reported in found.message
        assert found.fix == 'export PATH="/venv/bin:$PATH"'


def test_several_programs_of_our_name_are_worse_when_another_one_is_first() -> None:
    behind = replace(PATHS, obk_programs=("/venv/bin/obk", "/usr/bin/obk"))
    assert the_one(judge_paths(behind), "note").fix == "type -a obk"
    before = replace(PATHS, obk_programs=("/usr/bin/obk", "/venv/bin/obk"))
    assert the_one(judge_paths(before), "warning").fix == "type -a obk"


def test_a_ros2_program_of_another_distribution_is_reported() -> None:
    found = the_one(judge_paths(replace(PATHS, ros2_program="/opt/ros/humble/bin/ros2")), "warning")
    assert "of humble, and stacks run on jazzy" in found.message
    same = replace(PATHS, ros2_program="/opt/ros/jazzy/bin/ros2")
    assert severities(judge_paths(same)) == ["ok"]


def test_a_python_path_to_another_ros_is_reported() -> None:
    entry = "/opt/ros/jazzy/lib/python3.12/site-packages"
    world = replace(PATHS, python_path=(entry,), python_path_with_rclpy=(entry,))
    assert the_one(judge_paths(world), "warning").fix == "unset PYTHONPATH"


def test_a_python_path_to_another_pythons_packages_is_reported() -> None:
    world = replace(PATHS, python_path=("/opt/x/lib/python3.10/site-packages", "/mine"))
    found = the_one(judge_paths(world), "warning")
    assert found.message.endswith("3.12: /opt/x/lib/python3.10/site-packages")


def test_a_conda_environment_that_obk_is_not_in_is_noted() -> None:
    found = the_one(judge_paths(replace(PATHS, conda_prefix="/conda")), "note")
    assert found.fix == "conda deactivate"
    assert severities(judge_paths(replace(PATHS, conda_prefix="/venv"))) == ["ok"]


def test_libraries_of_another_ros_next_to_the_wheels_are_reported() -> None:
    world = replace(PATHS, libraries_with_rcl=("/opt/ros/jazzy/lib",))
    assert the_one(judge_paths(world), "warning").fix == "unset LD_LIBRARY_PATH"
    assert severities(judge_paths(replace(world, has_wheels=False))) == ["ok"]


def test_a_running_stack_is_noted_with_the_command_to_stop_it() -> None:
    world = StackFacts(running=(RunningStack(name="arm", domain=3, pid=42),), orphans=())
    found = the_one(judge_stacks(world), "note")
    assert found.fix == "obk stop arm"


def test_processes_left_behind_are_reported_with_the_command_that_ends_them() -> None:
    found = the_one(judge_stacks(StackFacts(running=(), orphans=("7 python",))), "warning")
    assert found.fix == "obk reap"
