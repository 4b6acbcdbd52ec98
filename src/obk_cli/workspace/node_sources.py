"""The Python source behind an executable, found by path: read, never imported or run."""

import io
import re
import sys
import tokenize
from collections.abc import Callable, Iterable
from importlib.machinery import PathFinder
from pathlib import Path

from obk_cli.config.environment import CodeFault, Command, NodeFacts
from obk_cli.diagnostics.source import SourceFile
from obk_cli.source_analysis.entry_point import read_node_code
from obk_cli.source_analysis.modules import FoundSource, Module, parse_module
from obk_cli.workspace.package_index import PackageIndex

__all__ = ["NodeSources"]

_PROGRAM = "__main__"
_LIBRARY = "obelisk_py"
_RUNS_MODULE = re.compile(r"python[\d.]*\"?(?:\s+-[A-Za-z]+)*\s+-m\s+([\w.]+)")
_LONGEST_SCRIPT_BYTES = 1_000_000


class NodeSources:
    """Finds and reads the source of nodes.

    `shown` gives the path to show; `note` gets every file that is looked for,
    before it is read.
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

    def read(self, command: Command) -> NodeFacts | CodeFault | None:
        """What the source of a command says, None where it is not Python or not to be had."""
        if command.module is not None:
            return self._read_module(command.module, command.function, command.python_path)
        program = Path(command.arguments[0])
        self._note(program)
        text = _script_text(program)
        first = text.partition("\n")[0]
        if "python" in first:
            source = FoundSource(source=SourceFile.of(self._shown(program), text))
            return read_node_code(
                _PROGRAM,
                None,
                lambda name: (
                    parse_module(name, source) if name == _PROGRAM else self._load(name, ())
                ),
            )
        runs = _RUNS_MODULE.search(text)
        return self._read_module(runs[1], None, ()) if runs else None

    def _read_module(
        self, module: str, function: str | None, path: tuple[Path, ...]
    ) -> NodeFacts | CodeFault | None:
        installed = (module.partition(".")[0],)
        if function is None and self._is_package(module, path, installed):
            module = f"{module}.{_PROGRAM}"
        if path and self._find(module, path, installed) is None:
            # A package that is laid out in a way of its own is not looked for further.
            top = self._folders[module.partition(".")[0], path]
            return _no_module(module, top[0]) if top else None
        return read_node_code(module, function, lambda name: self._load(name, path, installed))

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
            may_be_installed = top == _LIBRARY or top in installed
            self._folders[key] = tuple(self._tops(top, path, may_be_installed))
        for place in self._folders[key]:
            stem = place.joinpath(*rest)
            for file in (stem / "__init__.py", stem.with_suffix(".py")):
                self._note(file)
                if file.is_file():
                    return file
        return None

    def _tops(self, top: str, path: tuple[Path, ...], may_be_installed: bool) -> Iterable[Path]:
        """Where a top-level package or module may stand, its suffix left off."""
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


def _no_module(module: str, top: Path) -> CodeFault:
    return CodeFault(
        message=f"is not there, although the entry point names the module `{module}`",
        place=str(top.joinpath(*module.split(".")[1:]).with_suffix(".py")),
    )


def _script_text(path: Path) -> str:
    """The text of a program that starts with `#!`, empty for any other."""
    try:
        with path.open("rb") as file:
            data = file.read(_LONGEST_SCRIPT_BYTES) if file.read(2) == b"#!" else b""
    except OSError:
        return ""
    return ("#!" + data.decode("utf-8", errors="replace")) if data else ""


def _python_text(path: Path) -> str | None:
    """The text of a Python file in the encoding that it names, None if that cannot be read."""
    try:
        data = path.read_bytes()
        encoding, _ = tokenize.detect_encoding(io.BytesIO(data).readline)
        return data.decode(encoding)
    except (OSError, SyntaxError, UnicodeDecodeError, LookupError):
        return None
