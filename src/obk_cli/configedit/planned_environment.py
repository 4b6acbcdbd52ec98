"""The environment of a config as it will be once the new node's package exists."""

from dataclasses import dataclass
from pathlib import Path

from obk_cli.config.environment import (
    Command,
    Environment,
    ExecutableMissing,
    ModelFault,
    ModelRead,
)
from obk_cli.config.node_facts import CodeFault, NodeFacts
from obk_cli.diagnostics.source import Span

__all__ = ["PlannedEnvironment"]


@dataclass(frozen=True, slots=True)
class PlannedEnvironment:
    """The environment of today with one executable more, of whose code nothing is known."""

    there: Environment
    package: str
    executable: str

    def find_package_share(self, name: str) -> Path | None:
        """The folder that holds a package's data."""
        return self.there.find_package_share(name)

    def package_names(self) -> tuple[str, ...]:
        """Every package, the new one too."""
        return tuple(sorted({*self.there.package_names(), self.package}))

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""
        return self.there.message_packages()

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines."""
        return self.there.message_names(package)

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How an executable is started."""
        if (package, executable) == (self.package, self.executable):
            return Command(arguments=(), found_in="what is being made")
        return self.there.find_executable(package, executable)

    def read_node_code(self, package: str, executable: str) -> NodeFacts | CodeFault | None:
        """What the Python source of an executable says."""
        if (package, executable) == (self.package, self.executable):
            return None
        return self.there.read_node_code(package, executable)

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """The facts of a model."""
        return self.there.read_model(path)

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file."""
        return self.there.model_line(path, line)

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """Where a model defines an element."""
        return self.there.model_element(path, kind, name)
