"""Where an MJCF file defines its elements: file, line and column.

A position-aware XML reader over the model and the files that it includes; no MuJoCo.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

__all__ = ["MjcfElement", "mjcf_elements", "mjcf_files"]

_SENSOR_SECTION = "sensor"


@dataclass(frozen=True, slots=True, kw_only=True)
class MjcfElement:
    """One named element; line and column of its `<`, from 1."""

    kind: str
    """`sensor` for every sensor type, else the tag."""
    name: str
    path: Path
    line: int
    column: int


def mjcf_elements(path: Path) -> Iterator[MjcfElement]:
    """The named elements and the options of a model, in the order of its files.

    A file that is missing or not XML ends the walk through it in silence: whoever loads the
    model says so.
    """
    yield from _elements(path, path.parent, frozenset())


def mjcf_files(path: Path) -> Iterator[Path]:
    """The files of a model: its own, those that it includes or attaches; missing ones too."""
    yield from dict.fromkeys(_files(path, path.parent, frozenset()))


def _files(path: Path, folder: Path, opened: frozenset[Path]) -> Iterator[Path]:
    if path in opened:
        return
    yield path
    includes: list[Path] = []
    scan = _Scan(path, folder, includes)
    scan.elements()
    for included in (*includes, *scan.attached):
        yield from _files(included, folder, opened | {path})


def _elements(path: Path, folder: Path, opened: frozenset[Path]) -> Iterator[MjcfElement]:
    if path in opened:
        return
    includes: list[Path] = []
    yield from _Scan(path, folder, includes).elements()
    for included in includes:
        yield from _elements(included, folder, opened | {path})


class _Scan:
    """One file's walk."""

    def __init__(self, path: Path, folder: Path, includes: list[Path]) -> None:
        self._path = path
        self._folder = folder
        self._includes = includes
        self.attached: list[Path] = []
        """Whole models that this one takes parts of."""
        self._open: list[str] = []
        self._found: list[MjcfElement] = []
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = lambda _: self._open.pop()

    def elements(self) -> list[MjcfElement]:
        """The elements up to the file's end or its first fault."""
        with contextlib.suppress(OSError, expat.ExpatError):
            self._parser.Parse(self._path.read_bytes(), True)
        return self._found

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        parent = self._open[-1] if self._open else ""
        self._open.append(tag)
        if tag == "include" and "file" in attributes:
            self._includes.append(self._folder / attributes["file"])
        elif tag == "model" and "file" in attributes:
            self.attached.append(self._folder / attributes["file"])
        if "name" not in attributes and tag != "option":
            return
        element = MjcfElement(
            kind=_SENSOR_SECTION if parent == _SENSOR_SECTION else tag,
            name=attributes.get("name", ""),
            path=self._path,
            line=self._parser.CurrentLineNumber,
            column=self._parser.CurrentColumnNumber + 1,
        )
        self._found.append(element)
