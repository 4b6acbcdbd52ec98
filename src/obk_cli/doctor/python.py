"""Check `python`: version and environment of the interpreter that runs obk."""

import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import obk_cli
from obk_cli.doctor.finding import Fact, Finding, error, note, ok, warning
from obk_cli.optional_deps import distribution_version

__all__ = ["PythonFacts", "judge_python", "probe_python"]


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
    """Of the installed distribution, None where obk runs without being installed."""
    obk_folder: str
    """Where obk's own modules lie."""


def judge_python(facts: PythonFacts) -> Iterator[Finding]:
    """The interpreter and its environment."""
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
    """Version, place, and whether it is an environment of its own."""
    is_conda = Path(sys.prefix, "conda-meta").is_dir()
    return PythonFacts(
        version=(sys.version_info.major, sys.version_info.minor, sys.version_info.micro),
        executable=sys.executable,
        prefix=sys.prefix,
        is_virtual=sys.prefix != sys.base_prefix or is_conda,
        obk_version=distribution_version("obelisk-cli"),
        obk_folder=str(Path(obk_cli.__file__).parent),
    )
