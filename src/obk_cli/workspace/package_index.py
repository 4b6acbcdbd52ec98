"""Find ROS packages: in the workspace, in sourced prefixes and in this Python's environment."""

import importlib.util
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Final

from obelisk_spec.names import OBELISK_MESSAGES, ROS_MESSAGES
from obk_cli.config.environment import UNSEARCHED, Command, ExecutableMissing, ReplacedMessages
from obk_cli.files import SHARED_FOLDER_BITS, is_untrusted
from obk_cli.workspace.cmake_lists import CMakeLists, read_cmake_lists
from obk_cli.workspace.entry_points import (
    EntryPoint,
    computes_console_scripts,
    installed_console_scripts,
    module_run_by,
    setup_scripts,
    source_console_scripts,
)
from obk_cli.workspace.overlay import overlay_prefixes

__all__ = [
    "PackageIndex",
    "declared_name",
    "find_workspace",
    "is_native",
    "is_workspace",
    "owner_of_module",
    "owner_of_package",
    "package_folders",
    "package_names_in",
]

_SKIPPED = {*UNSEARCHED, "node_modules", "site-packages", "__pycache__"}
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_FIELD = re.compile(r"^[ \t]*[\w/]+(?:<=\d+)?(?:\[[<=\d]*\])?[ \t]+([a-z]\w*)(?![ \t]*=|\w)", re.M)
"""A field of a message, not a constant."""
_PYTHON_PACKAGE_FILES = ("setup.py", "setup.cfg", "pyproject.toml")
_PACKAGE_FILES = ("package.xml", *_PYTHON_PACKAGE_FILES, "CMakeLists.txt")
_ELF: Final = b"\x7fELF"
_LONGEST_SHEBANG: Final = 255
_OF_OBELISK: Final = ("obelisk_py", "obelisk_recordings", "obelisk_spec", "obk_cli", "obk_testing")
"""Modules that a checkout in the workspace must not replace."""
_DEEPEST = 6
"""Maximum depth of a package below a workspace [folders]."""


def find_workspace(start: Path) -> Path:
    """The workspace that contains a folder: the nearest ancestor with a `src` folder or `.git`.

    Otherwise the nearest of the folder and the two above it that contains a package, otherwise the
    folder itself. The search stops at the home folder, and before folders that other users can
    write to, such as `/tmp`, and folders of another user.
    """
    folder = start.resolve()
    chain = tuple(_folders_up(folder))
    for ancestor in chain:
        if ancestor.parent != ancestor and is_workspace(ancestor):
            return ancestor
    for ancestor in chain[:3]:
        if _has_package_inside(ancestor):
            return ancestor
    return folder


def _folders_up(folder: Path) -> Iterator[Path]:
    """A folder and its ancestors that may be a workspace of its owner."""
    owners = {os.geteuid(), _owner_and_mode(folder)[0]}
    home = Path(os.path.realpath(Path("~").expanduser()))
    yield folder
    for child, parent in pairwise((folder, *folder.parents)):
        owner, mode = _owner_and_mode(parent)
        if child == home or owner not in owners or mode & SHARED_FOLDER_BITS:
            return
        yield parent


def _owner_and_mode(folder: Path) -> tuple[int, int]:
    """The owner and permissions of a folder; one that does not exist counts as this user's."""
    try:
        found = folder.stat()
    except OSError:
        return os.geteuid(), 0
    return found.st_uid, found.st_mode


def is_workspace(folder: Path) -> bool:
    """Whether a folder itself is a workspace: with packages in `src`, or a checkout."""
    # The `src` folder of a package contains its C++ code.
    has_packages = (folder / "src").is_dir() and not (folder / "package.xml").is_file()
    is_checkout = (folder / ".git").exists() and not is_untrusted(folder / ".git")
    return is_checkout or (has_packages and not is_untrusted(folder / "src"))


def _has_package_inside(folder: Path) -> bool:
    try:
        children = (child for child in folder.iterdir() if (child / "package.xml").is_file())
        return any(not is_untrusted(child) for child in children)
    except OSError:
        return False


@dataclass(frozen=True, kw_only=True)
class PackageIndex:
    """The packages that a stack can use; caches its results."""

    workspaces: tuple[Path, ...]
    prefixes: tuple[Path, ...]
    """Install prefixes: the workspaces' overlays, AMENT_PREFIX_PATH, then this Python's."""

    @classmethod
    def around(
        cls, folder: Path, working_folder: Path, environment: Mapping[str, str]
    ) -> "PackageIndex":
        """The packages for a config in `folder` when `obk` runs in `working_folder`."""
        own, current = find_workspace(folder), find_workspace(working_folder)
        workspaces = (own, current) if is_workspace(current) and current != own else (own,)
        listed = environment.get("AMENT_PREFIX_PATH", "").split(":")
        below = (Path(prefix) for prefix in (*listed, sys.prefix) if prefix)
        prefixes = dict.fromkeys((*overlay_prefixes(workspaces), *below))
        return cls(workspaces=workspaces, prefixes=tuple(prefixes))

    @cached_property
    def source_packages(self) -> Mapping[str, Path]:
        """Name -> folder of the packages in the workspaces."""
        packages: dict[str, Path] = {}
        for workspace in self.workspaces:
            for folder in _package_folders(workspace, 0):
                packages.setdefault(_package_name(folder), folder)
        return packages

    @cached_property
    def left_out_packages(self) -> Mapping[str, Path]:
        """Name -> folder of packages in folders of the workspaces that are not searched."""
        packages: dict[str, Path] = {}
        for workspace in self.workspaces:
            for unsearched in _unsearched_folders(workspace, 0):
                for folder in _package_folders(unsearched, 0):
                    packages.setdefault(_package_name(folder), folder)
        return packages

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines; None if the package does not exist."""
        share = self.find_package_share(package)
        return None if share is None else tuple(f.stem for f in _listed(share / "msg", ".msg"))

    def message_definition(self, package: str, name: str) -> str | None:
        """The definition of a message; None if it does not exist or cannot be read."""
        share = self.find_package_share(package)
        if share is None:
            return None
        file = share / "msg" / f"{name}.msg"
        try:
            return file.read_text(encoding="utf-8") if file.is_file() else None
        except (OSError, UnicodeDecodeError):
            return None

    def replaced_messages(self) -> tuple[ReplacedMessages, ...]:
        """The packages of the workspaces that replace one of Obelisk's and lack messages or fields.

        Fields are compared with the installed package, if there is one.
        """
        found = (self._replaced(name) for name in OBELISK_MESSAGES if name in self.source_packages)
        return tuple(one for one in found if one.types or one.fields)

    def _replaced(self, package: str) -> ReplacedMessages:
        folder = self.source_packages[package]
        own = {file.stem: file for file in _listed(folder / "msg", ".msg")}
        overlays = {*overlay_prefixes(self.workspaces)}
        shares = (p / "share" / package for p in self.prefixes if p not in overlays)
        installed = next((share for share in shares if _is_folder(share)), None)
        names = OBELISK_MESSAGES[package]
        return ReplacedMessages(
            package=package,
            folder=folder,
            types=tuple(name for name in names if name not in own),
            fields=tuple(
                f"{name}.{field}"
                for name in names
                if name in own and installed is not None
                for field in _fields(installed / "msg" / f"{name}.msg")
                if field not in _fields(own[name])
            ),
        )

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspaces that define messages."""
        sources = self.source_packages.items()
        return tuple(name for name, folder in sources if _listed(folder / "msg", ".msg"))

    def find_package_share(self, name: str) -> Path | None:
        """The folder with a package's data: its source folder or `share/<name>`."""
        source = self.source_packages.get(name)
        if source is not None:
            return source
        shares = (prefix / "share" / name for prefix in self.prefixes)
        return next((share for share in shares if _is_folder(share)), None)

    def has_package(self, name: str) -> bool:
        """Whether a package with this name exists anywhere."""
        if self.find_package_share(name) is not None:
            return True
        return any(_is_folder(prefix / "lib" / name) for prefix in self.prefixes)

    def package_names(self) -> tuple[str, ...]:
        """The names of all packages, for suggestions."""
        names = set(self.source_packages)
        for prefix in self.prefixes:
            shares = prefix / "share" / "ament_index" / "resource_index" / "packages"
            names.update(entry.name for entry in _listed(shares))
        return tuple(sorted(names))

    def files_of(self, package: str) -> tuple[Path, ...]:
        """The files that define the executables of a source package, even missing ones."""
        folder = self.source_packages.get(package)
        return tuple(folder / name for name in _PACKAGE_FILES) if folder else ()

    def searched(self) -> tuple[str, ...]:
        """The locations that are searched, for messages."""
        return (*(f"{w} (sources)" for w in self.workspaces), *(str(p) for p in self.prefixes))

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """The command of an executable: from source, otherwise installed, otherwise in `lib`."""
        source = self.source_packages.get(package)
        in_source = source_console_scripts(source) if source else {}
        if source is not None and executable in in_source:
            entry = in_source[executable]
            path = self._python_path(source, source / entry.package_root)
            return _python_command(entry, path)
        scripts = self._source_scripts(package)
        if source is not None and executable in scripts:
            path = self._python_path(source, *_python_roots(source))
            return _program_command(scripts[executable], path)
        installed = installed_console_scripts(package)
        if executable in installed:
            return _python_command(installed[executable])
        programs = self._lib_programs(package)
        if executable in programs:
            return _program_command(programs[executable])
        is_found = self.has_package(package) or bool(installed)
        cmake = read_cmake_lists(source) if source else None
        declared = cmake.executables if cmake else frozenset()
        return ExecutableMissing(
            package=package,
            executable=executable,
            package_found=is_found,
            left_out=None if is_found else self.left_out_packages.get(package),
            not_executable=self._without_execute_bit(package, executable),
            unsourced=self._unsourced(package, executable),
            computed_in=_file_that_computes(source, cmake) if source and not programs else None,
            is_of_cmake=cmake is not None,
            declared_in=cmake.path if cmake and executable in declared else None,
            searched=self.searched(),
            available=tuple(sorted({*in_source, *scripts, *installed, *programs, *declared})),
        )

    def _without_execute_bit(self, package: str, executable: str) -> Path | None:
        """A program with that name that lacks the execute bit."""
        source = self.source_packages.get(package)
        folders = (
            *([source / "scripts"] if source else []),
            *(prefix / "lib" / package for prefix in self.prefixes),
        )
        programs = (folder / executable for folder in folders)
        return next((program for program in programs if os.path.isfile(program)), None)  # noqa: PTH113

    def _unsourced(self, package: str, executable: str) -> Path | None:
        """A program with that name that colcon installed in a workspace, in either layout."""
        prefixes = (p for w in self.workspaces for p in (w / "install" / package, w / "install"))
        programs = (prefix / "lib" / package / executable for prefix in prefixes)
        return next((program for program in programs if os.path.isfile(program)), None)  # noqa: PTH113

    def _source_scripts(self, package: str) -> Mapping[str, Path]:
        """Programs of a source package: those that its build installs, and those in `scripts`."""
        folder = self.source_packages.get(package)
        if folder is None:
            return {}
        scripts = {path.name: path for path in _listed(folder / "scripts") if _is_program(path)}
        cmake = read_cmake_lists(folder)
        named = (folder / name for name in setup_scripts(folder))
        installed = {path.name: path for path in named} | dict(cmake.programs if cmake else {})
        # A build sets the execute bit of what it installs.
        return scripts | {
            name: path for name, path in installed.items() if _is_program(path) or _is_python(path)
        }

    def _python_path(self, package: Path, *own: Path) -> tuple[Path, ...]:
        """Where a package's nodes find modules: in all of its workspace, as if that were built."""
        workspace = next(one for one in self.workspaces if package.is_relative_to(one))
        roots = (root for root in self._python_roots if root.is_relative_to(workspace))
        return tuple(dict.fromkeys((*own, *roots)))

    @cached_property
    def _python_roots(self) -> tuple[Path, ...]:
        return tuple(
            root
            for folder in self.source_packages.values()
            for root in _python_roots(folder)
            if not any(_is_folder(root / name) for name in _OF_OBELISK)
        )

    def _lib_programs(self, package: str) -> Mapping[str, Path]:
        """Programs in `<prefix>/lib/<package>` of all prefixes; the first prefix wins."""
        programs: dict[str, Path] = {}
        for prefix in self.prefixes:
            for path in _listed(prefix / "lib" / package):
                if _is_program(path):
                    programs.setdefault(path.name, path)
        return programs


def _python_roots(package: Path) -> Iterator[Path]:
    """The folders of a source package from which its Python modules are imported."""
    cmake = read_cmake_lists(package)
    yield from (root for root in (cmake.python_roots if cmake else ()) if _is_folder(root))
    if any(_has(package, name) for name in _PYTHON_PACKAGE_FILES):
        roots = (package, package / "src")
        yield from (root for root in roots if any(_has(c, "__init__.py") for c in _listed(root)))


def _python_command(entry: EntryPoint, path: tuple[Path, ...] = ()) -> Command:
    code = f"import sys; from {entry.module} import {entry.function}; sys.exit({entry.function}())"
    return Command(
        # -P: files in the working folder must not shadow libraries.
        arguments=(sys.executable, "-P", "-c", code),
        python_path=path,
        module=entry.module,
        function=entry.function,
    )


def _is_folder(path: Path) -> bool:
    """Whether the folder exists; False for an invalid or too long name."""
    return os.path.isdir(path)  # noqa: PTH112  (`Path.is_dir` raises)


def _program_command(program: Path, path: tuple[Path, ...] = ()) -> Command:
    is_program = _is_program(program)
    return Command(
        arguments=(str(program),) if is_program else (sys.executable, str(program)),
        python_path=path,
        module=module_run_by(program) if is_program else None,
    )


def is_native(program: Path) -> bool:
    """Whether a program is machine code, as compiled from C++."""
    try:
        with program.open("rb") as file:
            return file.read(len(_ELF)) == _ELF
    except OSError:
        return False


def _file_that_computes(package: Path, cmake: CMakeLists | None) -> Path | None:
    """The file of a package in source that computes names of its executables."""
    if computes_console_scripts(package):
        return package / "setup.py"
    return cmake.path if cmake is not None and cmake.computes_executables else None


def _is_program(path: Path) -> bool:
    return path.is_file() and path.stat().st_mode & 0o111 != 0


def _is_python(path: Path) -> bool:
    """Whether a file is a Python script, judged by its name or first line."""
    if path.suffix == ".py":
        return path.is_file()
    try:
        with path.open("rb") as file:
            first = file.read(_LONGEST_SHEBANG).partition(b"\n")[0]
    except OSError:
        return False
    return first.startswith(b"#!") and b"python" in first


def _listed(folder: Path, suffix: str = "") -> tuple[Path, ...]:
    try:
        return tuple(sorted(file for file in folder.iterdir() if file.name.endswith(suffix)))
    except OSError:
        return ()


def _fields(definition: Path) -> tuple[str, ...]:
    """The fields of a message; empty if the file cannot be read."""
    try:
        text = definition.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ()
    return tuple(_FIELD.findall(text))


def package_folders(workspace: Path) -> Iterator[Path]:
    """The folders with a package.xml below a workspace, within the search depth."""
    yield from _package_folders(workspace, 0)


def package_names_in(workspace: Path) -> tuple[str, ...]:
    """The names of the packages in a workspace."""
    return tuple(sorted({_package_name(folder) for folder in package_folders(workspace)}))


def _package_folders(folder: Path, depth: int) -> Iterator[Path]:
    """Folders with a package.xml; packages within packages are ignored."""
    if _has(folder, "COLCON_IGNORE"):
        return
    manifest = folder / "package.xml"
    if _has(folder, manifest.name) and manifest.is_file() and not is_untrusted(manifest):
        yield folder
        return
    for child in _searched_children(folder, depth):
        yield from _package_folders(child, depth + 1)


def _has(folder: Path, name: str) -> bool:
    """Whether a folder has a file; fast, because a workspace may have thousands of folders."""
    return os.path.exists(f"{folder}/{name}")  # noqa: PTH110  (several times as fast as pathlib's)


def _searched_children(folder: Path, depth: int) -> Iterator[Path]:
    if depth == _DEEPEST:
        return
    for name in _searched_names(folder):
        child = folder / name
        is_open = os.access(child, os.X_OK)
        if is_open and not _is_foreign(child) and not _leads_back(child):
            yield child


def _searched_names(folder: Path) -> Sequence[str]:
    """The sorted names of subfolders; fast, because a workspace may have many other files."""
    try:
        with os.scandir(folder) as entries:
            folders = [entry.name for entry in entries if _is_searched(entry)]
    except OSError:
        return ()
    return sorted(folders)


def _is_searched(entry: "os.DirEntry[str]") -> bool:
    if entry.name.startswith(".") or entry.name in _SKIPPED:
        return False
    try:
        return entry.is_dir()
    except OSError:  # a circular link
        return False


def _is_foreign(folder: Path) -> bool:
    """Whether it is a Python environment, or was created by another user."""
    return _has(folder, "pyvenv.cfg") or is_untrusted(folder)


def _leads_back(folder: Path) -> bool:
    """Whether it is a link to a folder that contains it, whose content would be found again."""
    if not folder.is_symlink():
        return False
    return Path(os.path.realpath(folder.parent)).is_relative_to(os.path.realpath(folder))


def _unsearched_folders(folder: Path, depth: int) -> Iterator[Path]:
    """The folders below one that are skipped because builds write into them."""
    yield from (folder / name for name in UNSEARCHED if (folder / name).is_dir())
    for child in _searched_children(folder, depth):
        yield from _unsearched_folders(child, depth + 1)


def declared_name(folder: Path) -> str | None:
    """The name in a folder's package.xml; None if it is unreadable or missing."""
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    name = _NAME.search(text)
    return name[1] if name else None


def _package_name(folder: Path) -> str:
    """The declared name of a package, otherwise the name of its folder."""
    return declared_name(folder) or folder.name


def owner_of_module(name: str) -> str | None:
    """The owner of a reserved module name, as words after "is"; None if it is free."""
    return "a module of Python's standard library" if name in sys.stdlib_module_names else None


def owner_of_package(name: str, *, own_folder: Path, index: PackageIndex) -> str | None:
    """The owner of a package name, as words after "is"; `own_folder` does not count."""
    module = owner_of_module(name)
    if module is not None:
        return module
    if name in OBELISK_MESSAGES or name in ROS_MESSAGES:
        return "a ROS message package"
    share = index.find_package_share(name)
    if share is not None and not _inside(share, own_folder):
        return f"a ROS package ({share})"
    spec = importlib.util.find_spec(name)
    # A folder without `__init__.py` on the path does not count, even if Python can import it.
    if spec is None or spec.origin is None or _inside(Path(spec.origin), own_folder):
        return None
    return f"an installed Python module ({spec.origin})"


def _inside(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
