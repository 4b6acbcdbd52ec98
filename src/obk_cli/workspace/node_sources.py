"""Find the Python source of an executable by path; it is read, never imported or run."""

import io
import re
import sys
import tokenize
from collections.abc import Callable, Iterable
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path

from obelisk_spec.names import OBELISK_MESSAGES
from obk_cli.config.environment import CodeFault, Command, NodeCode
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.optional_deps import how_to_install_ros
from obk_cli.source_analysis.entry_point import read_node_code
from obk_cli.source_analysis.imports import ImportPlaces
from obk_cli.source_analysis.modules import FoundSource, Module, parse_module
from obk_cli.workspace.package_index import PackageIndex

__all__ = ["NodeSources"]

_PROGRAM = "__main__"
_LIBRARY = "obelisk_py"
_ROS_LIBRARY = "rclpy"
_RUNS_MODULE = re.compile(r"python[\d.]*\"?(?:\s+-[A-Za-z]+)*\s+-m\s+([\w.]+)")
_LONGEST_SCRIPT_BYTES = 1_000_000


class NodeSources:
    """Finds and reads the source of nodes.

    `shown` returns the path to show; `note` receives every file that is searched for, before it is
    read.
    """

    def __init__(
        self,
        packages: PackageIndex,
        shown: Callable[[Path], str],
        note: Callable[[Path], object] = lambda _: None,
    ) -> None:
        self._packages = packages
        self._shown = shown
        self._note = note
        self._modules: dict[tuple[str, Path], Module | None] = {}
        self._folders: dict[tuple[str, tuple[Path, ...]], tuple[Path, ...]] = {}

    def read(self, command: Command) -> NodeCode | None:
        """What a command's source defines; None if it is not Python or was not found."""
        if command.module is not None:
            return self._read_module(command.module, command.function, command.python_path)
        program = command.program
        self._note(program)
        text = _script_text(program)
        first = text.partition("\n")[0]
        if "python" in first:
            source = FoundSource(source=SourceFile.of(self._shown(program), text))
            path = (program.parent, *command.python_path)
            return read_node_code(
                _PROGRAM,
                None,
                lambda name: (
                    parse_module(name, source) if name == _PROGRAM else self._load(name, path)
                ),
                self._import_places(path, (), runs_here=False),
            )
        runs = _RUNS_MODULE.search(text)
        return self._read_module(runs[1], None, ()) if runs else None

    def hazards(self, command: Command) -> tuple[Diagnostic, ...]:
        """Code of a command that may behave differently between two lockstep runs."""
        if command.module is None:
            return ()
        # Only `obk validate --for-test` and lockstep runs need them.
        from obk_cli.source_analysis.hazards import find_hazards

        path, installed = command.python_path, (command.module.partition(".")[0],)
        return find_hazards(
            self._entry_module(command.module, command.function, path),
            command.function,
            lambda name: self._load(name, path, installed),
        )

    def _read_module(
        self, module: str, function: str | None, path: tuple[Path, ...]
    ) -> NodeCode | None:
        installed = (module.partition(".")[0],)
        module = self._entry_module(module, function, path)
        if path and self._find(module, path, installed) is None:
            # A package with an unusual layout is not searched any further.
            top = self._folders[module.partition(".")[0], path]
            return _no_module(module, top[0]) if top else None
        return read_node_code(
            module,
            function,
            lambda name: self._load(name, path, installed),
            self._import_places(path, installed, runs_here=function is not None),
        )

    def _entry_module(self, module: str, function: str | None, path: tuple[Path, ...]) -> str:
        """The module whose text a command runs: `__main__` for a package run as a program."""
        is_program = function is None and self._is_package(module, path, (module.split(".")[0],))
        return f"{module}.{_PROGRAM}" if is_program else module

    def _import_places(
        self, path: tuple[Path, ...], installed: Iterable[str], *, runs_here: bool
    ) -> ImportPlaces:
        """Where a node's imports are searched for; `runs_here` if this Python runs it."""
        return ImportPlaces(
            may_exist=lambda name: self._may_exist(name, path, installed, runs_here=runs_here),
            siblings=lambda name: self._siblings(name, path, installed),
            is_read=lambda name: (
                name.partition(".")[0] != _ROS_LIBRARY
                and (runs_here or name.partition(".")[0] != _LIBRARY)
            ),
            is_own=lambda name: (
                name.partition(".")[0] not in (_LIBRARY, _ROS_LIBRARY)
                and self._find(name, path, installed) is not None
            ),
            message_names=self._message_names,
            missing_ros=self._missing_ros,
        )

    def _missing_ros(self) -> str | None:
        """How to install ROS 2; None if this Python or a sourced installation has it."""
        return None if self._is_installed(_ROS_LIBRARY) else how_to_install_ros()

    def _message_names(self, module: str) -> tuple[str, ...] | None:
        """The messages of `<package>.msg`; None if the package's definitions are not found."""
        package, _, submodule = module.partition(".")
        replaced = package in OBELISK_MESSAGES and package in self._packages.source_packages
        if submodule != "msg" or replaced:  # OBK413 reports what a replaced package lacks
            return None
        return self._packages.message_names(package) or None

    def _may_exist(
        self, module: str, path: tuple[Path, ...], installed: Iterable[str], *, runs_here: bool
    ) -> bool:
        """Whether an import may succeed; False only if it must fail."""
        top, _, rest = module.partition(".")
        if self._find(module, path, installed) is not None:
            return True
        places = self._folders[top, path]
        if not places:
            return bool(rest) or not runs_here or self._is_installed(top)
        if not rest or top == _ROS_LIBRARY or (top == _LIBRARY and not runs_here):
            return True
        spec = _spec_of(top)
        elsewhere = spec.submodule_search_locations or () if spec else ()
        if {Path(folder).resolve() for folder in elsewhere} - {place.resolve() for place in places}:
            return True
        return any(_may_hold(place, rest) for place in places)

    def _is_installed(self, top: str) -> bool:
        """Whether this Python, or a sourced ROS installation, may have a package."""
        if top in sys.stdlib_module_names or top in self._packages.source_packages:
            return True
        in_prefix = (
            found
            for prefix in self._packages.prefixes
            for pattern in ("lib/python3*/*-packages", "local/lib/python3*/*-packages")
            for folder in prefix.glob(pattern)
            for found in folder.glob(f"{top}*")
        )
        return _spec_of(top) is not None or any(in_prefix)

    def _siblings(
        self, module: str, path: tuple[Path, ...], installed: Iterable[str]
    ) -> tuple[str, ...]:
        """The modules of the package that would contain a module, or the workspace's packages."""
        package, _, _ = module.rpartition(".")
        if not package:
            return tuple(self._packages.source_packages)
        file = self._find(package, path, installed)
        if file is None or file.name != "__init__.py":
            return ()
        names = (f.stem if f.suffix == ".py" else f.name for f in file.parent.iterdir())
        return tuple(f"{package}.{name}" for name in sorted(names) if not name.startswith("_"))

    def _is_package(self, module: str, path: tuple[Path, ...], installed: Iterable[str]) -> bool:
        file = self._find(module, path, installed)
        return file is not None and file.name == "__init__.py"

    def _load(
        self, module: str, path: tuple[Path, ...], installed: Iterable[str] = ()
    ) -> Module | None:
        file = self._find(module, path, installed)
        if file is None:
            return None
        if (module, file) not in self._modules:
            text = _python_text(file)
            self._modules[module, file] = (
                None
                if text is None
                else parse_module(
                    module,
                    FoundSource(
                        source=SourceFile.of(self._shown(file), text),
                        is_package=file.name == "__init__.py",
                    ),
                )
            )
        return self._modules[module, file]

    def _find(self, module: str, path: tuple[Path, ...], installed: Iterable[str]) -> Path | None:
        """The file of a module: in the workspace, or of an installed package that may be read."""
        top, *rest = module.split(".")
        key = (top, path)
        if key not in self._folders:
            may_be_installed = top in (_LIBRARY, _ROS_LIBRARY, *installed)
            self._folders[key] = tuple(self._tops(top, path, may_be_installed))
        for place in self._folders[key]:
            stem = place.joinpath(*rest)
            for file in (stem / "__init__.py", stem.with_suffix(".py")):
                self._note(file)
                if file.is_file():
                    return file
        return None

    def _tops(self, top: str, path: tuple[Path, ...], may_be_installed: bool) -> Iterable[Path]:
        """Possible locations of a top-level package or module, without suffix."""
        sources = self._packages.source_packages.values()
        for root in (*path, *(r for s in sources for r in (s, s / "src"))):
            if (root / top).is_dir() or (root / top).with_suffix(".py").is_file():
                yield root / top
        if may_be_installed:
            own = Path(__file__).parents[2]  # the tool and the library are one distribution
            spec = PathFinder.find_spec(top, [str(own), *sys.path])
            if spec is not None and spec.submodule_search_locations:
                yield from (Path(location) for location in spec.submodule_search_locations)
            elif spec is not None and spec.origin:
                yield Path(spec.origin).with_suffix("")


def _spec_of(top: str) -> ModuleSpec | None:
    """Where this Python finds a package, without importing it."""
    try:
        return find_spec(top)
    except (ImportError, ValueError, AttributeError):
        return None


def _may_hold(package: Path, rest: str) -> bool:
    """Whether a package has, or may get when built, a module that is not a `.py` file."""
    stem = package.joinpath(*rest.split("."))
    if stem.is_dir() or not stem.parent.is_dir():
        return stem.is_dir()
    if any(entry.name.startswith(f"{stem.name}.") for entry in stem.parent.iterdir()):
        return True
    return any((root / "CMakeLists.txt").is_file() for root in package.parents[:2])


def _no_module(module: str, top: Path) -> CodeFault:
    return CodeFault(
        message=f"does not exist, although the entry point names the module `{module}`",
        place=str(top.joinpath(*module.split(".")[1:]).with_suffix(".py")),
    )


def _script_text(path: Path) -> str:
    """The text of a program that starts with `#!`; empty for any other."""
    try:
        with path.open("rb") as file:
            data = file.read(_LONGEST_SCRIPT_BYTES) if file.read(2) == b"#!" else b""
    except OSError:
        return ""
    return ("#!" + data.decode("utf-8", errors="replace")) if data else ""


def _python_text(path: Path) -> str | None:
    """The text of a Python file in its declared encoding; None if it cannot be read."""
    try:
        data = path.read_bytes()
        encoding, _ = tokenize.detect_encoding(io.BytesIO(data).readline)
        return data.decode(encoding)
    except (OSError, SyntaxError, UnicodeDecodeError, LookupError):
        return None
