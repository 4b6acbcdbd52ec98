"""Checks of Python, ROS 2, the middleware and Obelisk's messages, in fake worlds."""

from dataclasses import replace

import pytest

from obk_cli.doctor.installation import PythonFacts, judge_python
from obk_cli.doctor.interfaces import InterfaceFacts, judge_interfaces
from obk_cli.doctor.ros import RmwFacts, RosFacts, judge_rmw, judge_ros
from obk_cli.install_source import install_command

from .findings import severities, the_one

PYTHON = PythonFacts(
    version=(3, 12, 1),
    executable="/venv/bin/python",
    prefix="/venv",
    is_virtual=True,
    obk_version="0.1.0",
    obk_folder="/venv/lib/obk_cli",
)
ROS = RosFacts(
    rclpy_folder="/venv/rclpy",
    rclpy_version="7.1.6",
    wheels_distribution="jazzy",
    ros_distro=None,
    machine="x86_64",
    sourceable=(),
    unlike_pins={},
)
RMW = RmwFacts(
    installed=("rmw_fastrtps_cpp",),
    asked_for=None,
    used="rmw_fastrtps_cpp",
    domain=0,
    domain_fault="",
    range="LOCALHOST",
    notes=(),
)
INTERFACES = InterfaceFacts(
    version="0.1.0", faults={}, loaded=("obelisk_std_msgs",), stale=(), has_sources=False
)


def test_a_healthy_world_gives_no_findings() -> None:
    found = [*judge_python(PYTHON), *judge_ros(ROS), *judge_rmw(RMW)]
    assert set(severities([*found, *judge_interfaces(INTERFACES)])) == {"ok"}


def test_a_python_that_is_too_old_is_an_error() -> None:
    found = the_one(judge_python(replace(PYTHON, version=(3, 10, 4))), "error")
    assert found.facts["version"] == "3.10.4"


def test_a_python_without_ros_wheels_is_reported() -> None:
    the_one(judge_python(replace(PYTHON, version=(3, 14, 0))), "warning")


def test_the_systems_own_python_is_noted() -> None:
    found = the_one(judge_python(replace(PYTHON, is_virtual=False)), "note")
    assert found.fix == "python3 -m venv .venv"


def test_an_obk_that_is_not_installed_is_reported() -> None:
    found = the_one(judge_python(replace(PYTHON, obk_version=None)), "warning")
    assert found.fix.startswith("pip install --editable ")


@pytest.mark.parametrize(
    ("machine", "sourceable", "fix"),
    [
        ("x86_64", (), install_command("ros")),
        ("aarch64", (), "apt install ros-jazzy-ros-base && . /opt/ros/jazzy/setup.sh"),
        ("aarch64", ("/opt/ros/jazzy/setup.sh",), ". /opt/ros/jazzy/setup.sh"),
    ],
)
def test_without_ros_the_fix_is_the_one_for_this_machine(
    machine: str, sourceable: tuple[str, ...], fix: str
) -> None:
    world = replace(ROS, rclpy_folder=None, machine=machine, sourceable=sourceable)
    assert the_one(judge_ros(world), "error").fix == fix


def test_a_sourced_ros_of_another_distribution_than_the_wheels_is_reported() -> None:
    the_one(judge_ros(replace(ROS, ros_distro="humble")), "warning")


def test_a_sourced_ros_that_obk_is_not_tested_with_is_reported() -> None:
    world = replace(ROS, wheels_distribution=None, ros_distro="rolling")
    the_one(judge_ros(world), "warning")


def test_wheels_of_other_versions_are_reported_with_both() -> None:
    world = replace(ROS, unlike_pins={"ros-std-msgs": ("5.5.1", "5.3.6")})
    assert "ros-std-msgs 5.5.1" in the_one(judge_ros(world), "warning").message


def test_an_invalid_domain_is_an_error() -> None:
    world = replace(RMW, domain=None, domain_fault="ROS_DOMAIN_ID=x is not a number")
    found = the_one(judge_rmw(world), "error")
    assert (found.message, found.fix) == (world.domain_fault, "export ROS_DOMAIN_ID=0")


def test_no_middleware_is_an_error() -> None:
    the_one(judge_rmw(replace(RMW, installed=())), "error")


@pytest.mark.parametrize(
    ("sentence", "fix"),
    [
        ("RMW_IMPLEMENTATION=rmw_x is not installed here", "unset RMW_IMPLEMENTATION"),
        ("ROS cannot write its log files into /h/.ros/log", "export ROS_LOG_DIR=/tmp/ros-logs"),
        ("ROS_LOCALHOST_ONLY=1 keeps devices apart", "unset ROS_LOCALHOST_ONLY ROS_STATIC_PEERS"),
    ],
)
def test_changes_of_obk_for_its_processes_are_reported(sentence: str, fix: str) -> None:
    found = the_one(judge_rmw(replace(RMW, notes=(sentence,))), "warning")
    assert (found.message, found.fix) == (sentence, fix)


def test_another_middleware_that_works_is_noted() -> None:
    world = replace(RMW, asked_for="rmw_cyclonedds_cpp", used="rmw_cyclonedds_cpp")
    the_one(judge_rmw(world), "note")


@pytest.mark.parametrize(
    ("has_sources", "fix"), [(True, "make setup"), (False, install_command("ros"))]
)
def test_messages_that_cannot_be_loaded_are_an_error(has_sources: bool, fix: str) -> None:
    world = replace(
        INTERFACES, faults={"obelisk_std_msgs": "no such file"}, loaded=(), has_sources=has_sources
    )
    found = the_one(judge_interfaces(world), "error")
    assert found.fix == fix


def test_definitions_that_changed_since_they_were_compiled_are_reported() -> None:
    world = replace(INTERFACES, stale=("obelisk_std_msgs/msg/A.msg",))
    the_one(judge_interfaces(world), "warning")
