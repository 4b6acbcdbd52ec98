"""Where the files that a config names are: the config's folder, then the package's share.

Asks whether files exist and, where one does not, what its folder holds; opens none.
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from obelisk_spec.suggestions import near_names
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
        self._names: dict[Path, tuple[str, ...]] = {}

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
            if _is_file(path):
                return FileSearch(written=written, found=path, tried=tuple(tried))
        missing = package.value if package is not None and share is None else None
        return FileSearch(
            written=written,
            found=None,
            tried=tuple(tried),
            missing_package=missing,
            near=self._near(Path(written.value), tried),
        )

    def _near(self, written: Path, tried: Iterable[Path]) -> tuple[str, ...]:
        """Files of the same kind and much the same name in the folders that were looked into.

        Else those of the same name in the folders above and beside them.
        """
        if not written.name:
            return ()
        stems: dict[str, str] = {}
        elsewhere: dict[Path, str] = {}
        for path in tried:
            for name in self._names_in(path.parent):
                if Path(name).suffix == written.suffix and name != path.name:
                    stems.setdefault(Path(name).stem, str(written.with_name(name)))
            if written.is_absolute() or path.parts[-len(written.parts) :] != written.parts:
                continue  # a link or `..` leads elsewhere
            base = path.parents[len(written.parts) - 1]
            for name in self._names_in(base):
                for other in (base / name, base / name / written.name):
                    if other.name == written.name and _is_file(other):
                        elsewhere.setdefault(other, str(other.relative_to(base)))
        near = tuple(stems[stem] for stem in near_names(written.stem, stems))
        return near or tuple(elsewhere.values())

    def _names_in(self, folder: Path) -> tuple[str, ...]:
        if folder not in self._names:
            try:
                self._names[folder] = tuple(sorted(path.name for path in folder.iterdir()))
            except OSError:
                self._names[folder] = ()
        return self._names[folder]

    def _places(self, written: Spanned[str], share: Path | None, subfolder: str) -> Iterator[Path]:
        path = Path(written.value)
        if path.is_absolute():
            yield path
            return
        yield _real(self._folder / path)
        own = Path(written.span.path).parent
        if own.is_dir():
            # A fragment that was included may name files next to itself.
            yield _real(own / path)
        if share is not None:
            yield share / subfolder / path
            yield share / path


def _real(path: Path) -> Path:
    """The path without links; one that leads to itself ends where it is."""
    return Path(os.path.realpath(path))  # `Path.resolve` raises


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that none can have, one too long, is no error."""
    return os.path.isfile(path)  # noqa: PTH113  (`Path.is_file` raises)
