"""The search paths of the shell, and what of ROS and of obk lies on them."""

import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from obk_cli.adapters.probes.ros import wheels_distribution
from obk_cli.doctor.paths import PathFacts

__all__ = ["probe_paths"]


def probe_paths(environment: Mapping[str, str]) -> PathFacts:
    """What is where; `environment` is the shell's."""
    wheels = wheels_distribution()
    own = Path(sys.executable).with_name("obk")
    python_path = _entries(environment, "PYTHONPATH")
    libraries = _entries(environment, "LD_LIBRARY_PATH")
    return PathFacts(
        obk_programs=tuple(dict.fromkeys(_programs("obk", environment))),
        this_obk=str(own) if own.is_file() else None,
        ros2_program=shutil.which("ros2", path=environment.get("PATH", "")),
        distribution=wheels or environment.get("ROS_DISTRO"),
        python_path=python_path,
        python_path_with_rclpy=tuple(p for p in python_path if Path(p, "rclpy").is_dir()),
        has_wheels=wheels is not None,
        python_version=f"{sys.version_info.major}.{sys.version_info.minor}",
        conda_prefix=environment.get("CONDA_PREFIX") or None,
        prefix=sys.prefix,
        libraries_with_rcl=tuple(filter(_holds_foreign_ros, libraries)),
    )


def _programs(name: str, environment: Mapping[str, str]) -> Iterator[str]:
    """The programs of a name on PATH; links to one place count once, under their first name."""
    seen: set[Path] = set()
    for folder in _entries(environment, "PATH"):
        program = Path(folder, name)
        if os.access(program, os.X_OK) and program.resolve() not in seen:
            seen.add(program.resolve())
            yield str(program)


def _holds_foreign_ros(folder: str) -> bool:
    return Path(folder, "librcl.so").exists() and not Path(folder).is_relative_to(sys.prefix)


def _entries(environment: Mapping[str, str], name: str) -> tuple[str, ...]:
    return tuple(entry for entry in environment.get(name, "").split(os.pathsep) if entry)
