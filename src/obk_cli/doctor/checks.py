"""The table of checks: for each the probe that looks and the judge that says what it means."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final, TypeVar

from obk_cli.adapters.probes.compiler import probe_compiler
from obk_cli.adapters.probes.discovery import probe_discovery
from obk_cli.adapters.probes.display import probe_display
from obk_cli.adapters.probes.folders import probe_folders
from obk_cli.adapters.probes.interfaces import probe_interfaces
from obk_cli.adapters.probes.mujoco import probe_mujoco
from obk_cli.adapters.probes.multicast import probe_multicast
from obk_cli.adapters.probes.paths import probe_paths
from obk_cli.adapters.probes.python import probe_python
from obk_cli.adapters.probes.ros import probe_rmw, probe_ros
from obk_cli.adapters.probes.shared_memory import probe_shared_memory
from obk_cli.adapters.probes.stacks import probe_stacks
from obk_cli.adapters.probes.timing import probe_cpu, probe_realtime
from obk_cli.doctor.compiler import judge_compiler
from obk_cli.doctor.display import judge_display
from obk_cli.doctor.examination import Check
from obk_cli.doctor.finding import Finding
from obk_cli.doctor.folders import judge_folders
from obk_cli.doctor.interfaces import judge_interfaces
from obk_cli.doctor.memory import judge_shared_memory
from obk_cli.doctor.mujoco import judge_mujoco
from obk_cli.doctor.network import judge_discovery, judge_multicast
from obk_cli.doctor.paths import judge_paths
from obk_cli.doctor.python import judge_python
from obk_cli.doctor.ros import judge_rmw, judge_ros
from obk_cli.doctor.stacks import judge_stacks
from obk_cli.doctor.timing import judge_cpu, judge_realtime
from obk_cli.doctor.workspace import judge_workspace
from obk_cli.doctor.workspace_look import look_at_workspace

__all__ = ["checks_of"]


Facts = TypeVar("Facts")


def _check(
    name: str, about: str, probe: Callable[[], Facts], judge: Callable[[Facts], Iterable[Finding]]
) -> Check:
    return Check(name=name, about=about, find=lambda: judge(probe()))


OF_ROS: Final = (
    _check("python", "Python's version and environment", probe_python, judge_python),
    _check("ros", "the ROS 2 that is used, and its version", probe_ros, judge_ros),
    _check("rmw", "middleware, ROS domain, discovery", probe_rmw, judge_rmw),
    _check("interfaces", "Obelisk's messages, loaded", probe_interfaces, judge_interfaces),
    _check("multicast", "UDP on this host", probe_multicast, judge_multicast),
    _check("discovery", "two ROS processes look for each other", probe_discovery, judge_discovery),
)
"""What nodes need to hear each other; one thing rests on another."""
OF_THE_MACHINE: Final = (
    _check("shared-memory", "room in /dev/shm", probe_shared_memory, judge_shared_memory),
    _check("compiler", "C, C++ and Python's headers", probe_compiler, judge_compiler),
    _check("mujoco", "a scene stepped and drawn", probe_mujoco, judge_mujoco),
    _check("display", "a screen for windows", probe_display, judge_display),
    _check("realtime", "priority and locked memory", probe_realtime, judge_realtime),
    _check("cpu", "processors, their load, the clock", probe_cpu, judge_cpu),
)


def checks_of(environment: Mapping[str, str], working_folder: Path) -> tuple[Check, ...]:
    """Every check, in the order in which they are told.

    Args:
        environment: the shell's variables.
        working_folder: where the user stands.
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
            "packages here, and what is to be built",
            lambda: look_at_workspace(working_folder, environment),
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
            "what runs, and what was left behind",
            lambda: probe_stacks(environment),
            judge_stacks,
        ),
    )
