"""Do several installations get in each other's way? Facts in, findings out."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Finding, note, ok, warning

__all__ = ["PathFacts", "judge_paths"]

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
        sentence = f"there are {len(programs)} programs `obk` on PATH: {', '.join(programs)}"
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
            f"PYTHONPATH leads to another ROS 2: {listed}; it does not fit the wheels",
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
            "libraries of both may meet",
            "conda deactivate",
            conda=facts.conda_prefix,
        )
