"""ROS packages and their executables: in the workspace, in this Python, on AMENT_PREFIX_PATH.

Reads folders and files; runs nothing and imports nothing of the user's.
"""

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from obk_cli.adapters.entry_points import (
    EntryPoint,
    installed_console_scripts,
    source_console_scripts,
)
from obk_cli.surroundings import Command, ExecutableMissing

__all__ = ["Command", "ExecutableMissing", "PackageIndex", "find_workspace"]

_SKIPPED = {"build", "install", "log", "node_modules", "site-packages", "__pycache__"}
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_DEEPEST = 6
"""Folders below a workspace in which a package may lie."""


def find_workspace(start: Path) -> Path:
    """The workspace around a folder: the nearest one up with a `src` folder or `.git`.

    Else the nearest of the folder and the two above it that has a package right inside, else the
    folder itself.
    """
    folder = start.resolve()
    chain = (folder, *folder.parents)
    for ancestor in chain:
        if ancestor.parent != ancestor and _is_workspace(ancestor):
            return ancestor
    for ancestor in chain[:3]:
        if _has_package_inside(ancestor):
            return ancestor
    return folder


def _is_workspace(folder: Path) -> bool:
    return (folder / ".git").exists() or (folder / "src").is_dir()


def _has_package_inside(folder: Path) -> bool:
    try:
        return any((child / "package.xml").is_file() for child in folder.iterdir())
    except OSError:
        return False


@dataclass(frozen=True, kw_only=True)
class PackageIndex:
    """The packages that a stack can use; what was found once is remembered."""

    workspaces: tuple[Path, ...]
    prefixes: tuple[Path, ...]
    """Install prefixes, AMENT_PREFIX_PATH first, then this Python's."""

    @classmethod
    def around(
        cls, folder: Path, working_folder: Path, environment: Mapping[str, str]
    ) -> "PackageIndex":
        """The packages for a config in `folder` when `obk` runs in `working_folder`."""
        own, current = find_workspace(folder), find_workspace(working_folder)
        workspaces = (own, current) if _is_workspace(current) and current != own else (own,)
        listed = environment.get("AMENT_PREFIX_PATH", "").split(":")
        prefixes = dict.fromkeys(Path(prefix) for prefix in (*listed, sys.prefix) if prefix)
        return cls(workspaces=workspaces, prefixes=tuple(prefixes))

    @cached_property
    def source_packages(self) -> Mapping[str, Path]:
        """Name -> folder of the packages in the workspaces."""
        packages: dict[str, Path] = {}
        for workspace in self.workspaces:
            for folder in _package_folders(workspace, 0):
                packages.setdefault(_package_name(folder), folder)
        return packages

    def find_package_share(self, name: str) -> Path | None:
        """The folder that holds a package's data: its source folder or `share/<name>`."""
        source = self.source_packages.get(name)
        if source is not None:
            return source
        shares = (prefix / "share" / name for prefix in self.prefixes)
        return next((share for share in shares if share.is_dir()), None)

    def has_package(self, name: str) -> bool:
        """Whether a package of that name is anywhere."""
        if self.find_package_share(name) is not None:
            return True
        return any((prefix / "lib" / name).is_dir() for prefix in self.prefixes)

    def package_names(self) -> tuple[str, ...]:
        """Every package that is there, for did-you-mean."""
        names = set(self.source_packages)
        for prefix in self.prefixes:
            shares = prefix / "share" / "ament_index" / "resource_index" / "packages"
            names.update(entry.name for entry in _listed(shares))
        return tuple(sorted(names))

    def searched(self) -> tuple[str, ...]:
        """The places that are looked through, for a message."""
        return (*(f"{w} (sources)" for w in self.workspaces), *(str(p) for p in self.prefixes))

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """The command of an executable: from source, else installed, else by its lib folder."""
        source = self.source_packages.get(package)
        in_source = source_console_scripts(source) if source else {}
        if executable in in_source:
            return _python_command(in_source[executable], source, f"the sources in {source}")
        scripts = self._source_scripts(package)
        if executable in scripts:
            return Command(
                arguments=(str(scripts[executable]),), found_in=f"the sources in {source}"
            )
        installed = installed_console_scripts(package)
        if executable in installed:
            return _python_command(installed[executable], None, "an installed Python distribution")
        programs = self._lib_programs(package)
        if executable in programs:
            program = programs[executable]
            return Command(arguments=(str(program),), found_in=str(program.parent))
        return ExecutableMissing(
            package=package,
            executable=executable,
            package_found=self.has_package(package) or bool(installed),
            searched=self.searched(),
            available=tuple(sorted({*in_source, *scripts, *installed, *programs})),
        )

    def _source_scripts(self, package: str) -> Mapping[str, Path]:
        """Programs in the `scripts` folder of a source package."""
        folder = self.source_packages.get(package)
        if folder is None:
            return {}
        return {path.name: path for path in _listed(folder / "scripts") if _is_program(path)}

    def _lib_programs(self, package: str) -> Mapping[str, Path]:
        """Programs in `<prefix>/lib/<package>` of all prefixes, the first prefix winning."""
        programs: dict[str, Path] = {}
        for prefix in self.prefixes:
            for path in _listed(prefix / "lib" / package):
                if _is_program(path):
                    programs.setdefault(path.name, path)
        return programs


def _python_command(entry: EntryPoint, root: Path | None, found_in: str) -> Command:
    code = f"import sys; from {entry.module} import {entry.function}; sys.exit({entry.function}())"
    return Command(
        arguments=(sys.executable, "-c", code),
        python_path=(root / entry.package_root,) if root else (),
        found_in=found_in,
        module=entry.module,
        function=entry.function,
    )


def _is_program(path: Path) -> bool:
    return path.is_file() and path.stat().st_mode & 0o111 != 0


def _listed(folder: Path) -> tuple[Path, ...]:
    try:
        return tuple(sorted(folder.iterdir()))
    except OSError:
        return ()


def _package_folders(folder: Path, depth: int) -> Iterator[Path]:
    """Folders with a package.xml; a package is not looked into for further ones."""
    if (folder / "COLCON_IGNORE").exists():
        return
    if (folder / "package.xml").is_file():
        yield folder
        return
    if depth == _DEEPEST:
        return
    for child in _listed(folder):
        is_skipped = child.name.startswith(".") or child.name in _SKIPPED
        if not is_skipped and child.is_dir() and not (child / "pyvenv.cfg").exists():
            yield from _package_folders(child, depth + 1)


def _package_name(folder: Path) -> str:
    """The name in a package.xml; a broken file counts under its folder's name."""
    text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
    name = _NAME.search(text)
    return name[1] if name else folder.name
