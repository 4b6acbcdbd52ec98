"""An environment that is empty: no packages, no messages, no MuJoCo."""

from pathlib import Path

from obk_cli.config.environment import Command, ExecutableMissing, ModelFault, ModelRead
from obk_cli.diagnostics.source import Span


class Nowhere:
    """Finds nothing; errors within a stack are still found."""

    def find_package_share(self, name: str) -> Path | None:
        return None

    def manifest_fault(self, package: str) -> None:
        return None

    def package_names(self) -> tuple[str, ...]:
        return ()

    def message_packages(self) -> tuple[str, ...]:
        return ()

    def message_names(self, package: str) -> None:
        return None

    def replaced_messages(self) -> tuple[()]:
        return ()

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        raise AssertionError

    def read_node_code(self, package: str, executable: str) -> None:
        return None

    def read_hazards(self, package: str, executable: str) -> tuple[()]:
        return ()

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        return None

    def read_policy(self, path: Path) -> None:
        return None

    def model_line(self, path: Path, line: int) -> Span:
        raise AssertionError

    def is_cpp(self, package: str, executable: str) -> bool:
        return False

    def model_element(self, path: Path, kind: str, name: str) -> None:
        return None
