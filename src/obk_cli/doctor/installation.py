"""The `python` and `paths` checks: this installation of obk, others on the search paths."""

import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import obk_cli
from obk_cli.doctor.finding import Fact, Finding, error, note, ok, warning
from obk_cli.optional_deps import distribution_version, wheels_distribution

__all__ = ["PathFacts", "PythonFacts", "judge_paths", "judge_python", "probe_paths", "probe_python"]

OLDEST: Final = (3, 11)
NEWEST_WITH_WHEELS: Final = (3, 13)


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonFacts:
    """The interpreter that runs obk."""

    version: tuple[int, int, int]
    executable: str
    prefix: str
    is_virtual: bool
    """Whether it is in a virtual or a conda environment."""
    obk_version: str | None
    """Version of the installed distribution; None if obk runs without being installed."""
    obk_folder: str
    """The folder of obk's own modules."""


def judge_python(facts: PythonFacts) -> Iterator[Finding]:
    """Report the interpreter and its environment."""
    text = ".".join(map(str, facts.version))
    measured: dict[str, Fact] = {
        "version": text,
        "executable": facts.executable,
        "prefix": facts.prefix,
    }
    if facts.version[:2] < OLDEST:
        yield error(
            f"Python {text} is too old: obk needs 3.11 to 3.13",
            "python3.12 -m venv .venv",
            **measured,
        )
    elif facts.version[:2] > NEWEST_WITH_WHEELS:
        yield warning(
            f"Python {text} is newer than the versions that obk is tested with (3.11 to 3.13); "
            "no ROS wheels exist for it",
            "python3.12 -m venv .venv",
            **measured,
        )
    else:
        yield ok(f"Python {text} in {facts.prefix}", **measured)
    if not facts.is_virtual:
        yield note(
            f"{facts.executable} is the system Python; packages installed into it are shared",
            "python3 -m venv .venv",
        )
    if facts.obk_version is None:
        yield warning(
            f"obk runs from {facts.obk_folder} without being installed: "
            "nodes that import obelisk_py may not find it",
            f"pip install --editable {shlex.quote(str(Path(facts.obk_folder).parents[1]))}",
        )
    else:
        yield ok(f"obk {facts.obk_version} in {facts.obk_folder}", obk=facts.obk_version)


def probe_python() -> PythonFacts:
    """Find version and folder, and whether it is a separate environment."""
    is_conda = Path(sys.prefix, "conda-meta").is_dir()
    return PythonFacts(
        version=(sys.version_info.major, sys.version_info.minor, sys.version_info.micro),
        executable=sys.executable,
        prefix=sys.prefix,
        is_virtual=sys.prefix != sys.base_prefix or is_conda,
        obk_version=distribution_version("obelisk-cli"),
        obk_folder=str(Path(obk_cli.__file__).parent),
    )


_OF_DISTRIBUTION: Final = re.compile(r"/opt/ros/(?P<name>[a-z]+)/")
_OF_PYTHON: Final = re.compile(r"/python(?P<version>\d\.\d+)(?:/|$)")


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFacts:
    """The installations on the shell's search paths."""

    obk_programs: tuple[str, ...]
    """Every `obk` on PATH, each file once, in search order."""
    this_obk: str | None
    """The `obk` next to this Python; None if there is none."""
    ros2_program: str | None
    distribution: str | None
    """The ROS distribution that stacks use."""
    python_path: tuple[str, ...]
    """PYTHONPATH."""
    python_path_with_rclpy: tuple[str, ...]
    """The entries of PYTHONPATH that contain rclpy."""
    has_wheels: bool
    python_version: str
    """Such as `3.11`."""
    conda_prefix: str | None
    prefix: str
    libraries_with_rcl: tuple[str, ...]
    """Entries of LD_LIBRARY_PATH outside this environment that contain ROS 2."""


def judge_paths(facts: PathFacts) -> Iterator[Finding]:
    """Report which of several installations the shell uses."""
    found = [*_judge_obk(facts), *_judge_ros2(facts), *_judge_python_path(facts), *_conda(facts)]
    if facts.has_wheels and facts.libraries_with_rcl:
        listed = ":".join(facts.libraries_with_rcl)
        found.append(
            warning(f"LD_LIBRARY_PATH leads to another ROS 2: {listed}", "unset LD_LIBRARY_PATH")
        )
    yield from found or [ok("PATH, PYTHONPATH and LD_LIBRARY_PATH lead to one installation")]


def _judge_obk(facts: PathFacts) -> Iterator[Finding]:
    programs = facts.obk_programs
    if facts.this_obk is None:
        return
    if facts.this_obk not in programs:
        first = f"the shell's `obk` is {programs[0]}" if programs else "the shell finds no `obk`"
        bin_folder = facts.this_obk.rpartition("/")[0]
        yield note(
            f"{first}; this one is {facts.this_obk}",
            f'export PATH="{bin_folder}:$PATH"',
            obk=programs,
        )
    elif len(programs) > 1:
        sentence = f"PATH has {len(programs)} programs named `obk`: {', '.join(programs)}"
        fix = "type -a obk"
        is_first = programs[0] == facts.this_obk
        yield (note if is_first else warning)(sentence, fix, obk=programs)


def _judge_ros2(facts: PathFacts) -> Iterator[Finding]:
    of = _OF_DISTRIBUTION.search(facts.ros2_program or "")
    if of and facts.distribution and of["name"] != facts.distribution:
        yield warning(
            f"`ros2` is {facts.ros2_program}, of {of['name']}, and stacks run on "
            f"{facts.distribution}: it may not see their nodes or understand their messages",
            f". /opt/ros/{facts.distribution}/setup.sh",
            ros2=facts.ros2_program,
        )


def _judge_python_path(facts: PathFacts) -> Iterator[Finding]:
    if facts.has_wheels and facts.python_path_with_rclpy:
        listed = ":".join(facts.python_path_with_rclpy)
        yield warning(
            f"PYTHONPATH leads to another ROS 2: {listed}; it does not match the wheels",
            "unset PYTHONPATH",
            python_path=facts.python_path,
        )
    other = [
        entry
        for entry in facts.python_path
        if (of := _OF_PYTHON.search(entry)) and of["version"] != facts.python_version
    ]
    if other:
        yield warning(
            f"PYTHONPATH has packages of another Python than {facts.python_version}: "
            f"{':'.join(other)}",
            "unset PYTHONPATH",
            python_path=facts.python_path,
        )


def _conda(facts: PathFacts) -> Iterator[Finding]:
    if facts.conda_prefix and facts.conda_prefix != facts.prefix:
        yield note(
            f"the conda environment {facts.conda_prefix} is active, but obk runs in "
            f"{facts.prefix}: their libraries may conflict",
            "conda deactivate",
            conda=facts.conda_prefix,
        )


def probe_paths(environment: Mapping[str, str]) -> PathFacts:
    """Search the paths in the shell's environment."""
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
    """The programs with this name on PATH; links to one file count once, under their first name."""
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
