"""What the stages may ask of the world around a config, as types: packages, models, their lines.

The adapters answer; tests answer with tables. Looks at nothing itself.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from obelisk_spec.model import ModelFacts
from obelisk_spec.suggestions import list_names
from obk_cli.diagnostics.source import Span

if TYPE_CHECKING:
    from obk_cli.config.node_facts import CodeFault, NodeFacts

__all__ = [
    "UNSEARCHED",
    "Command",
    "Environment",
    "ExecutableMissing",
    "ModelFault",
    "ModelRead",
]

UNSEARCHED = ("build", "install", "log")
"""Folders of a workspace into which building writes: what is in them is a copy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """How an executable is started: the arguments, and what must be in the environment."""

    arguments: tuple[str, ...]
    python_path: tuple[Path, ...] = ()
    """Folders to put in front of PYTHONPATH."""
    found_in: str
    """For a person: where it was found."""
    module: str | None = None
    """The Python module that holds what is run, where that is known."""
    function: str | None = None
    """The function of `module` that is called; None for a module that is run as a program."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutableMissing:
    """An executable that is nowhere, and what was looked through."""

    package: str
    executable: str
    package_found: bool
    searched: tuple[str, ...]
    available: tuple[str, ...] = ()
    """Executables that the package does have."""
    left_out: Path | None = None
    """A folder with a package of that name, within one that is not searched."""

    @property
    def looked(self) -> str:
        """What a person is told of a package that is not found: where it was looked for."""
        searched = f"searched {', '.join(self.searched)}"
        if self.left_out is None:
            return searched
        return (
            f"it is in {self.left_out}, but folders named {list_names(UNSEARCHED)} are not "
            f"searched: move it, or source the workspace if it is installed there; {searched}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRead:
    """A model that could be read."""

    facts: ModelFacts
    wanted_files: tuple[tuple[str, str], ...] = ()
    """Meshes and textures, each by its path under its folder and by its path as written."""
    missing_files: tuple[str, ...] = ()
    """Those that are not where the model says."""
    fault: "ModelFault | None" = None
    """Why MuJoCo cannot compile it; not tried where files are missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFault:
    """A model that cannot be read; `line` counts from 1, None where none is named."""

    message: str
    line: int | None = None


class Environment(Protocol):
    """The questions."""

    def find_package_share(self, name: str) -> Path | None:
        """The folder that holds a package's data, None if there is no such package."""

    def package_names(self) -> tuple[str, ...]:
        """Every package that is there."""

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines, None if there is no such package."""

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How an executable is started."""

    def read_node_code(self, package: str, executable: str) -> "NodeFacts | CodeFault | None":
        """What the Python source of an executable says, None where that cannot be known."""

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """The facts of a model, None where MuJoCo is not installed."""

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file."""

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """Where a model defines an element of that kind and name."""
