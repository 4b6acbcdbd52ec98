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
_ENDS_FILES: Final = ("DESTINATION", "RENAME", "PERMISSIONS", "COMPONENT", "OPTIONAL")
"""Keywords after the files of `install(PROGRAMS ...)`."""


@dataclass(frozen=True)
class CMakeLists:
    """The CMakeLists.txt of a package."""

    path: Path
    text: str

    @cached_property
    def executables(self) -> frozenset[str]:
        """The names in `add_executable`."""
        return frozenset(given[0] for given in self._calls("add_executable") if given)

    @cached_property
    def programs(self) -> Mapping[str, Path]:
        """Executable -> file, for `install(PROGRAMS ... DESTINATION lib/<package>)`."""
        found: dict[str, Path] = {}
        for kind, *given in self._calls("install"):
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
            for name, *given in self._calls("ament_python_install_package")
            if folder.joinpath(_value("PACKAGE_DIR", given) or name).name == name
        )
        return tuple(dict.fromkeys(roots))

    def _calls(self, command: str) -> Iterator[list[str]]:
        """The arguments of each call of a command, without those that cannot be evaluated."""
        for name, given in _CALL.findall(self.text):
            if name.lower() == command:
                arguments = [word for word in self._expanded(given) if "$" not in word]
                if arguments:
                    yield arguments

    def _expanded(self, given: str) -> Iterator[str]:
        for quoted, bare in _ARGUMENT.findall(given):
            values = self._variables.get(bare[2:-1]) if _VARIABLE.fullmatch(bare) else None
            yield from values or [_replaced(quoted or bare, self._variables)]

    @cached_property
    def _project(self) -> str:
        return self._variables["PROJECT_NAME"][0]

    @cached_property
    def _variables(self) -> Mapping[str, Sequence[str]]:
        given = [
            (name.lower(), [quoted or bare for quoted, bare in _ARGUMENT.findall(words)])
            for name, words in _CALL.findall(self.text)
        ]
        projects = [words[0] for name, words in given if name == "project" and words]
        project = projects[0] if projects else self.path.parent.name
        found: dict[str, Sequence[str]] = {
            **{name: [project] for name in _NAMES},
            **{name: [str(self.path.parent)] for name in _FOLDERS},
        }
        for name, words in given:
            if name == "set" and words:
                values = [_replaced(word, found) for word in words[1:]]
                found[words[0]] = [value for value in values if len(value) < _LONGEST_VALUE]
        return found


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
