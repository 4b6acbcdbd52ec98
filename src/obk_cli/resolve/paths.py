"""Where the files that a config names are: the config's folder, then the package's share.

Asks whether files exist; opens none.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from obk_cli.config import FileSearch, Node, Sim, Spanned, Stack
from obk_cli.surroundings import Surroundings

__all__ = ["resolve_paths"]

_MODEL_FOLDER = "mujoco"


def resolve_paths(stack: Stack, folder: Path, surroundings: Surroundings) -> Stack:
    """The stack with every file looked for; `folder` is the config's."""
    search = _Search(folder, surroundings)
    return replace(stack, nodes=tuple(search.in_node(node) for node in stack.nodes))


class _Search:
    def __init__(self, folder: Path, surroundings: Surroundings) -> None:
        self._folder = folder
        self._surroundings = surroundings

    def in_node(self, node: Node) -> Node:
        """The node with its files."""
        return replace(
            node,
            sims=tuple(self._in_sim(sim) for sim in node.sims),
            params_file=self._file(node.params_path, node.pkg, ""),
            urdf_file=self._file(node.urdf, node.robot_pkg, "urdf"),
        )

    def _in_sim(self, sim: Sim) -> Sim:
        return replace(
            sim,
            model=self._file(sim.model_xml_path, sim.robot_pkg, _MODEL_FOLDER),
            files=tuple(
                file
                for path in sim.config_paths
                if (file := self._file(path, sim.robot_pkg, _MODEL_FOLDER))
            ),
        )

    def _file(
        self, written: Spanned[str] | None, package: Spanned[str] | None, subfolder: str
    ) -> FileSearch | None:
        if written is None:
            return None
        share = self._surroundings.find_package_share(package.value) if package else None
        tried: list[Path] = []
        for path in self._places(written, share, subfolder):
            if path not in tried:
                tried.append(path)
            if path.is_file():
                return FileSearch(written=written, found=path, tried=tuple(tried))
        missing = package.value if package is not None and share is None else None
        return FileSearch(written=written, found=None, tried=tuple(tried), missing_package=missing)

    def _places(self, written: Spanned[str], share: Path | None, subfolder: str) -> Iterator[Path]:
        path = Path(written.value)
        if path.is_absolute():
            yield path
            return
        yield (self._folder / path).resolve()
        own = Path(written.span.path).parent
        if own.is_dir():
            # A fragment that was included may name files next to itself.
            yield (own / path).resolve()
        if share is not None:
            yield share / subfolder / path
            yield share / path
