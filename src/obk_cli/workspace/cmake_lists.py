"""What a package's CMakeLists.txt declares, as far as it can be read without CMake.

Variables set by `set(NAME ...)` and the standard ones for the package's name and folder are
replaced; arguments with other variables are ignored.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

__all__ = ["CMakeLists", "read_cmake_lists"]

_COMMENT: Final = re.compile(r"#.*")
_CALL: Final = re.compile(r"\b(\w+)\s*\(([^()]*)\)")
_ARGUMENT: Final = re.compile(r'"([^"]*)"|([^\s"]+)')
_VARIABLE: Final = re.compile(r"\$\{(\w+)\}")
_FOLDERS: Final = ("CMAKE_CURRENT_SOURCE_DIR", "CMAKE_CURRENT_LIST_DIR", "CMAKE_SOURCE_DIR")
_NAMES: Final = ("PROJECT_NAME", "CMAKE_PROJECT_NAME")
_LONGEST_VALUE: Final = 4096
"""Longer values of variables are ignored, because each may contain another one several times."""
_MAKE_EXECUTABLES: Final = ("add_executable", "ament_auto_add_executable")
_REGISTER_COMPONENT: Final = "rclcpp_components_register_node"
_BIND_VARIABLES: Final = ("foreach", "function", "macro")
_ENDS_FILES: Final = ("DESTINATION", "RENAME", "PERMISSIONS", "COMPONENT", "OPTIONAL")
"""Keywords after the files of `install(PROGRAMS ...)`."""


@dataclass(frozen=True)
class CMakeLists:
    """The CMakeLists.txt of a package."""

    path: Path
    text: str

    @cached_property
    def executables(self) -> frozenset[str]:
        """The executables with a name that is known without CMake."""
        return frozenset(name for name in self._executables if "$" not in name)

    @cached_property
    def computes_executables(self) -> bool:
        """Whether a macro, a loop or an unknown variable computes names of executables."""
        return len(self.executables) < len(self._executables)

    @cached_property
    def _executables(self) -> frozenset[str]:
        names = [words[0] for name, words in self._calls if name in _MAKE_EXECUTABLES and words]
        components = [words for name, words in self._calls if name == _REGISTER_COMPONENT]
        return frozenset(filter(None, (*names, *(_value("EXECUTABLE", w) for w in components))))

    @cached_property
    def programs(self) -> Mapping[str, Path]:
        """Executable -> file, for `install(PROGRAMS ... DESTINATION lib/<package>)`."""
        found: dict[str, Path] = {}
        for kind, *given in self._known("install"):
            if kind != "PROGRAMS" or _value("DESTINATION", given) != f"lib/{self._project}":
                continue
            ends = [place for place, word in enumerate(given) if word in _ENDS_FILES]
            name = _value("RENAME", given)
            for file in given[: min(ends, default=len(given))]:
                found[name or Path(file).name] = self.path.parent / file
        return found

    @cached_property
    def python_roots(self) -> tuple[Path, ...]:
        """The folders that contain the modules of `ament_python_install_package`."""
        folder = self.path.parent
        roots = (
            folder.joinpath(_value("PACKAGE_DIR", given) or name).parent
            for name, *given in self._known("ament_python_install_package")
            if folder.joinpath(_value("PACKAGE_DIR", given) or name).name == name
        )
        return tuple(dict.fromkeys(roots))

    def _known(self, command: str) -> Iterator[list[str]]:
        """The arguments of each call of a command, without those that cannot be evaluated."""
        for name, words in self._calls:
            arguments = [word for word in words if "$" not in word]
            if name == command and arguments:
                yield arguments

    @cached_property
    def _project(self) -> str:
        projects = (words[0] for name, words in self._calls if name == "project" and words)
        return next(projects, self.path.parent.name)

    @cached_property
    def _calls(self) -> Sequence[tuple[str, Sequence[str]]]:
        """Every command with its arguments, where variables without a known value are left."""
        variables: dict[str, Sequence[str]] = {
            **{name: [self.path.parent.name] for name in _NAMES},
            **{name: [str(self.path.parent)] for name in _FOLDERS},
        }
        calls: list[tuple[str, Sequence[str]]] = []
        for name, given in _CALL.findall(self.text):
            command = name.lower()
            written = [quoted or bare for quoted, bare in _ARGUMENT.findall(given)]
            calls.append((command, list(_expanded(given, variables))))
            if command == "project":
                variables.update(dict.fromkeys(_NAMES, written[:1]))
            elif command == "set" and written:
                values = [_replaced(word, variables) for word in written[1:]]
                variables[written[0]] = [v for v in values if len(v) < _LONGEST_VALUE]
            elif command in _BIND_VARIABLES:
                for word in written:
                    variables.pop(word, None)
        return calls


def _expanded(given: str, variables: Mapping[str, Sequence[str]]) -> Iterator[str]:
    for quoted, bare in _ARGUMENT.findall(given):
        values = variables.get(bare[2:-1]) if _VARIABLE.fullmatch(bare) else None
        yield from values or [_replaced(quoted or bare, variables)]


def _value(keyword: str, given: Sequence[str]) -> str | None:
    """The argument after a keyword."""
    place = given.index(keyword) + 1 if keyword in given else len(given)
    return given[place] if place < len(given) else None


def _replaced(word: str, variables: Mapping[str, Sequence[str]]) -> str:
    """The word with variables of one value replaced."""

    def value(found: re.Match[str]) -> str:
        values = variables.get(found[1], ())
        return values[0] if len(values) == 1 else found[0]

    return _VARIABLE.sub(value, word)


def read_cmake_lists(package: Path) -> CMakeLists | None:
    """The CMakeLists.txt in the folder of a package; None if it cannot be read."""
    path = package / "CMakeLists.txt"
    if not path.is_file():  # reading a pipe or a device might never return
        return None
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return CMakeLists(path=path, text=_COMMENT.sub("", text))
