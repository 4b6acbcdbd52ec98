"""The table of checks: a probe gathers facts, a judge interprets them."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final, TypeVar

from obk_cli.doctor.compiler import judge_compiler, probe_compiler
from obk_cli.doctor.display import judge_display, probe_display
from obk_cli.doctor.finding import Finding
from obk_cli.doctor.interfaces import judge_interfaces, probe_interfaces
from obk_cli.doctor.memory import judge_shared_memory, probe_shared_memory
from obk_cli.doctor.mujoco import judge_mujoco, probe_mujoco
from obk_cli.doctor.network import (
    judge_discovery,
    judge_multicast,
    probe_discovery,
    probe_multicast,
)
from obk_cli.doctor.paths import judge_folders, judge_paths, probe_folders, probe_paths
from obk_cli.doctor.python import judge_python, probe_python
from obk_cli.doctor.ros import judge_rmw, judge_ros, probe_rmw, probe_ros
from obk_cli.doctor.runner import Check
from obk_cli.doctor.stacks import judge_stacks, probe_stacks
from obk_cli.doctor.timing import judge_cpu, judge_realtime, probe_cpu, probe_realtime
from obk_cli.doctor.workspace import judge_workspace, probe_workspace

__all__ = ["checks_of"]


Facts = TypeVar("Facts")


def _check(
    name: str, about: str, probe: Callable[[], Facts], judge: Callable[[Facts], Iterable[Finding]]
) -> Check:
    return Check(name=name, about=about, find=lambda: judge(probe()))


OF_ROS: Final = (
    _check("python", "Python's version and environment", probe_python, judge_python),
    _check("ros", "the ROS 2 in use and its version", probe_ros, judge_ros),
    _check("rmw", "middleware, ROS domain, discovery", probe_rmw, judge_rmw),
    _check("interfaces", "loading of Obelisk's messages", probe_interfaces, judge_interfaces),
    _check("multicast", "UDP on this host", probe_multicast, judge_multicast),
    _check("discovery", "two ROS processes find each other", probe_discovery, judge_discovery),
)
"""Needed to exchange messages; later checks depend on earlier ones."""
OF_THE_MACHINE: Final = (
    _check("shared-memory", "room in /dev/shm", probe_shared_memory, judge_shared_memory),
    _check("compiler", "C, C++ and Python's headers", probe_compiler, judge_compiler),
    _check("mujoco", "stepping and drawing a scene", probe_mujoco, judge_mujoco),
    _check("display", "a screen for windows", probe_display, judge_display),
    _check("realtime", "priority and locked memory", probe_realtime, judge_realtime),
    _check("cpu", "processors, their load, the clock", probe_cpu, judge_cpu),
)


def checks_of(environment: Mapping[str, str], working_folder: Path) -> tuple[Check, ...]:
    """Every check, in the order of the report.

    Args:
        environment: the shell's variables.
        working_folder: the current folder.
    """
    return (
        *OF_ROS,
        *OF_THE_MACHINE,
        _check(
            "folders",
            "room for runs, caches, temporary files",
            lambda: probe_folders(environment),
            judge_folders,
        ),
        _check(
            "workspace",
            "packages here and their build state",
            lambda: probe_workspace(working_folder, environment),
            judge_workspace,
        ),
        _check(
            "paths",
            "several installations of obk, ROS or Python",
            lambda: probe_paths(environment),
            judge_paths,
        ),
        _check(
            "stacks",
            "running stacks and leftover processes",
            lambda: probe_stacks(environment),
            judge_stacks,
        ),
    )
