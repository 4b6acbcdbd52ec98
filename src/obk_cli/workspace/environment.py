"""Look up packages and models on this machine, for the stages of the compiler."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from obelisk_spec.onnx_policy import Network, NetworkError, has_onnxruntime
from obk_cli.config.environment import (
    CodeFault,
    Command,
    ExecutableMissing,
    ModelFault,
    ModelRead,
    NodeCode,
    PolicyFault,
    PolicyRead,
    ReplacedMessages,
)
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.workspace.model_reader import (
    MjcfElement,
    cache_folder,
    has_mujoco,
    mjcf_elements,
    mjcf_files,
    read_model_once,
)
from obk_cli.workspace.node_sources import NodeSources
from obk_cli.workspace.package_index import PackageIndex, is_native

__all__ = ["MachineEnvironment"]


class MachineEnvironment:
    """One compilation's view of the machine; every file is read at most once.

    `note` receives each file on which the results depend, before it is read.
    """

    def __init__(
        self,
        folder: Path,
        working_folder: Path,
        environment: Mapping[str, str],
        note: Callable[[Path], object] | None = None,
    ) -> None:
        self._note = note
        self.packages = PackageIndex.around(folder, working_folder, environment)
        self._working_folder = working_folder
        self._cache = cache_folder(environment)
        self._node_sources: NodeSources | None = None
        self._models: dict[Path, ModelRead | ModelFault | None] = {}
        self._elements: dict[Path, dict[tuple[str, str], MjcfElement]] = {}
        self._sources: dict[Path, SourceFile] = {}
        self._commands: dict[tuple[str, str], Command | ExecutableMissing] = {}
        self._codes: dict[tuple[str, str], NodeCode | None] = {}

    def find_package_share(self, name: str) -> Path | None:
        """The folder with a package's data."""
        return self.packages.find_package_share(name)

    def manifest_fault(self, package: str) -> CodeFault | None:
        """Why the package.xml of a source package cannot be read."""
        folder = self.packages.source_packages.get(package)
        if folder is None:
            return None
        path = folder / "package.xml"
        self._note_all([path])
        source = self._source(path)
        from xml.parsers import expat  # rarely needed

        parser = expat.ParserCreate()
        elements: list[str] = []
        parser.StartElementHandler = lambda name, _: elements.append(name)
        try:
            parser.Parse(path.read_bytes(), True)
        except expat.ExpatError as error:
            place = Span.at(source, error.lineno, error.offset + 1)
            reason = expat.ErrorString(error.code)
            return CodeFault(
                message=f"is not well-formed XML: {reason}", place=source.path, span=place
            )
        except OSError:
            return None
        if "name" in elements:
            return None
        start = Span.at(source, 1, 1)
        return CodeFault(message="has no `<name>`", place=source.path, span=start)

    def package_names(self) -> tuple[str, ...]:
        """The names of all packages."""
        return self.packages.package_names()

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""
        return self.packages.message_packages()

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines."""
        share = self.packages.find_package_share(package)
        self._note_all([share / "msg"] if share else ())
        return self.packages.message_names(package)

    def replaced_messages(self) -> tuple[ReplacedMessages, ...]:
        """The workspace packages that replace one of Obelisk's and lack messages or fields."""
        found = self.packages.replaced_messages()
        self._note_all(one.folder / "msg" for one in found)
        return found

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How to start an executable."""
        key = (package, executable)
        if key not in self._commands:
            self._note_all(self.packages.files_of(package) if self._note else ())
            self._commands[key] = self.packages.find_executable(package, executable)
        return self._commands[key]

    def read_node_code(self, package: str, executable: str) -> NodeCode | None:
        """What the Python source of an executable defines."""
        key = (package, executable)
        if key not in self._codes:
            command = self.find_executable(package, executable)
            self._codes[key] = (
                self._sources_of_nodes().read(command) if isinstance(command, Command) else None
            )
        return self._codes[key]

    def read_hazards(self, package: str, executable: str) -> tuple[Diagnostic, ...]:
        """Code of an executable that may behave differently between two lockstep runs."""
        command = self.find_executable(package, executable)
        return self._sources_of_nodes().hazards(command) if isinstance(command, Command) else ()

    def is_cpp(self, package: str, executable: str) -> bool:
        """Whether an executable is C++: native, in CMakeLists.txt, or in a `*_cpp` package."""
        command = self.find_executable(package, executable)
        if isinstance(command, ExecutableMissing):
            is_declared = command.declared_in is not None
            is_computed = command.computed_in is not None and command.is_of_cmake
            is_unknown = not command.package_found and package.endswith("_cpp")
            return is_declared or is_computed or is_unknown
        return command.module is None and is_native(command.program)

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """Facts about a model; None without MuJoCo."""
        if path not in self._models:
            self._note_all(mjcf_files(path) if self._note else ())
            read = read_model_once(path, self._cache) if has_mujoco() else None
            referenced = read.referenced_files if isinstance(read, ModelRead) else ()
            self._note_all(path.parent / file for pair in referenced for file in pair)
            self._models[path] = read
        return self._models[path]

    def read_policy(self, path: Path) -> PolicyRead | PolicyFault | None:
        """The input and output sizes of a network; None without onnxruntime."""
        self._note_all([path] if self._note else ())
        if not has_onnxruntime():
            return None
        try:
            network = Network(path)
        except NetworkError as error:
            return PolicyFault(message=str(error))
        return PolicyRead(inputs=network.inputs, outputs=network.outputs)

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file, without its indentation."""
        source = self._source(path)
        text = source.line(line)
        start = len(text) - len(text.lstrip())
        return Span.at(source, line, start + 1, max(len(text.strip()), 1))

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """The location where a model defines an element."""
        if path not in self._elements:
            self._elements[path] = {}
            for element in mjcf_elements(path):
                self._elements[path].setdefault((element.kind, element.name), element)
        found = self._elements[path].get((kind, name))
        if found is None:
            return None
        source = self._source(found.path)
        line, start = source.line(found.line), found.column - 1
        end = line.find(">", start) + 1 or len(line.rstrip())
        return Span.at(source, found.line, found.column, max(end - start, 1))

    def _sources_of_nodes(self) -> NodeSources:
        if self._node_sources is None:
            note = self._note or (lambda _: None)
            self._node_sources = NodeSources(self.packages, self._shown, note)
        return self._node_sources

    def _note_all(self, paths: Iterable[Path]) -> None:
        if self._note is not None:
            for path in paths:
                self._note(path)

    def _source(self, path: Path) -> SourceFile:
        if path not in self._sources:
            try:
                text = path.read_text(encoding="utf-8", errors="replace")
            except OSError:
                text = ""
            self._sources[path] = SourceFile.of(self._shown(path), text)
        return self._sources[path]

    def _shown(self, path: Path) -> str:
        """The path relative to the working folder, as a user would write it."""
        if path.is_relative_to(self._working_folder):
            return os.path.relpath(path, self._working_folder)
        return str(path)
