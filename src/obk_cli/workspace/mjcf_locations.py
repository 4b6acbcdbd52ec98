"""Where an MJCF file defines its elements: file, line and column.

A position-aware XML reader over the model and the files that it includes; no MuJoCo.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
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
    for scan in _scans(path, lambda scan: scan.includes):
        yield from scan.found


def mjcf_files(path: Path) -> Iterator[Path]:
    """The files of a model: its own, those that it includes or attaches; missing ones too."""
    for scan in _scans(path, lambda scan: [*scan.includes, *scan.attached]):
        yield scan.path


def _scans(path: Path, named: Callable[["_Scan"], list[Path]]) -> Iterator["_Scan"]:
    """A model's files, each once, however often and by whatever way it is named."""
    waiting = [path]
    seen: set[str] = set()
    while waiting:
        file = waiting.pop()
        real = os.path.realpath(file)
        if real not in seen:
            seen.add(real)
            scan = _Scan(file, path.parent)
            yield scan
            waiting += reversed(named(scan))


class _Scan:
    """One file's walk, up to its end or its first fault."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path = path
        self.found: list[MjcfElement] = []
        self.includes: list[Path] = []
        self.attached: list[Path] = []
        """Whole models that this one takes parts of."""
        self._folder = folder
        self._open: list[str] = []
        # As MuJoCo reads it, whatever encoding the file says that it has.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = lambda _: self._open.pop()
        with contextlib.suppress(OSError, expat.ExpatError):
            if path.is_file():  # a pipe or a device might never end
                self._parser.Parse(path.read_bytes(), True)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        parent = self._open[-1] if self._open else ""
        self._open.append(tag)
        if tag == "include" and "file" in attributes:
            self.includes.append(self._folder / attributes["file"])
        elif tag == "model" and "file" in attributes:
            self.attached.append(self._folder / attributes["file"])
        if "name" not in attributes and tag != "option":
            return
        element = MjcfElement(
            kind=_SENSOR_SECTION if parent == _SENSOR_SECTION else tag,
            name=attributes.get("name", ""),
            path=self.path,
            line=self._parser.CurrentLineNumber,
            column=self._parser.CurrentColumnNumber + 1,
        )
        self.found.append(element)
