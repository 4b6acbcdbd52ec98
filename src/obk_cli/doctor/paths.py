"""Check `paths`: whether the shell's search paths lead to several installations."""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import GIB, MIB, Fact, Finding, bytes_text, note, ok, warning
from obk_cli.doctor.memory import write_fault
from obk_cli.doctor.ros import wheels_distribution
from obk_cli.runs.folder import runs_folder
from obk_cli.workspace.model_cache import cache_folder

__all__ = [
    "FolderFacts",
    "PathFacts",
    "judge_folders",
    "judge_paths",
    "probe_folders",
    "probe_paths",
]

_OF_DISTRIBUTION: Final = re.compile(r"/opt/ros/(?P<name>[a-z]+)/")
_OF_PYTHON: Final = re.compile(r"/python(?P<version>\d\.\d+)(?:/|$)")


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFacts:
    """What the search paths of the shell lead to."""

    obk_programs: tuple[str, ...]
    """Every `obk` on PATH, each file once, first come first."""
    this_obk: str | None
    """The `obk` beside this Python, None where there is none."""
    ros2_program: str | None
    distribution: str | None
    """The ROS distribution that stacks run with."""
    python_path: tuple[str, ...]
    """PYTHONPATH."""
    python_path_with_rclpy: tuple[str, ...]
    """Those of its entries that hold an rclpy."""
    has_wheels: bool
    python_version: str
    """Such as `3.11`."""
    conda_prefix: str | None
    prefix: str
    libraries_with_rcl: tuple[str, ...]
    """Entries of LD_LIBRARY_PATH, those of this environment aside, that hold a ROS 2."""


def judge_paths(facts: PathFacts) -> Iterator[Finding]:
    """Which of several installations the shell finds."""
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
        cure = "type -a obk"
        is_first = programs[0] == facts.this_obk
        yield (note if is_first else warning)(sentence, cure, obk=programs)


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
            f"the conda environment {facts.conda_prefix} is active and obk runs in {facts.prefix}: "
            "their libraries may conflict",
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


ENOUGH_BYTES: Final = GIB
LEAST_BYTES: Final = 100 * MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderFacts:
    """One folder that obk writes to."""

    purpose: str
    """What is kept there."""
    folder: str | None
    """None: the user has no place for it."""
    fault: str
    """Why nothing can be written there; empty: it can."""
    free_bytes: int
    mover: str
    """The variable that puts the folder elsewhere."""


def judge_folders(folders: tuple[FolderFacts, ...]) -> Iterator[Finding]:
    """Each folder that obk writes to."""
    for facts in folders:
        move = f"export {facts.mover}=/a/folder/with/room"
        measured: dict[str, Fact] = {"folder": facts.folder, "free_bytes": facts.free_bytes}
        if facts.folder is None:
            yield warning(f"no folder is available for {facts.purpose}", move)
        elif facts.fault:
            yield warning(f"{facts.purpose}: {facts.folder}: {facts.fault}", move, **measured)
        elif facts.free_bytes < ENOUGH_BYTES:
            much = "almost full" if facts.free_bytes < LEAST_BYTES else "filling up"
            yield warning(
                f"{facts.purpose}: the disk of {facts.folder} is {much}, "
                f"{bytes_text(facts.free_bytes)} free",
                f"du -sh {facts.folder}    # or: {move}",
                **measured,
            )
        else:
            yield ok(
                f"{facts.purpose}: {facts.folder}, {bytes_text(facts.free_bytes)} free", **measured
            )


def probe_folders(environment: Mapping[str, str]) -> tuple[FolderFacts, ...]:
    """Measure each folder, or its nearest existing parent."""
    return (
        _facts("runs and their logs", runs_folder(environment), "OBK_HOME"),
        _facts("the cache of models", cache_folder(environment), "XDG_CACHE_HOME"),
        _facts("temporary files", Path(tempfile.gettempdir()), "TMPDIR"),
    )


def _facts(purpose: str, folder: Path | None, mover: str) -> FolderFacts:
    if folder is None:
        return FolderFacts(purpose=purpose, folder=None, fault="", free_bytes=0, mover=mover)
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    is_folder = existing.is_dir()
    space = os.statvfs(existing)
    return FolderFacts(
        purpose=purpose,
        folder=str(folder),
        fault=write_fault(existing) if is_folder else f"{existing} is a file",
        free_bytes=space.f_frsize * space.f_bavail,
        mover=mover,
    )
