"""A package's package.xml: what it says, and dependencies added to it.

In: its text. Out: name and build type, or the text with more dependencies and the rest kept.
Never touches the disk.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree import ElementTree

__all__ = ["PackageIdentity", "add_dependencies", "read_identity"]

_DEPENDS = frozenset({"depend", "exec_depend"})
_DEPEND_LINE = re.compile(r"^([ \t]*)<(?:exec_)?depend\b[^>]*>[^<]*</(?:exec_)?depend>", re.M)
_PACKAGE_END = re.compile(r"^([ \t]*)</package>", re.M)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageIdentity:
    """What package.xml says that a package is.

    Source: REP 149 (package.xml format 3): without a build type it is `catkin`.
    """

    name: str
    build_type: str


def read_identity(package_xml: str) -> PackageIdentity | None:
    """Name and build type, None where the text is no package.xml."""
    root = _parse(package_xml)
    name = None if root is None else root.findtext("name")
    if root is None or not name:
        return None
    build_type = root.findtext("export/build_type") or "catkin"
    return PackageIdentity(name=name.strip(), build_type=build_type.strip())


def add_dependencies(package_xml: str, dependencies: Iterable[str]) -> str:
    """Add an `exec_depend` for each package that is not there, after the last one that is."""
    root = _parse(package_xml)
    have = set() if root is None else {(e.text or "").strip() for e in root if e.tag in _DEPENDS}
    missing = sorted(set(dependencies) - have)
    newline = "\r\n" if "\r\n" in package_xml else "\n"
    places = list(_DEPEND_LINE.finditer(package_xml))
    if places:
        at, indent = places[-1].end(), places[-1][1]
        lines = "".join(f"{newline}{indent}{_exec_depend(name)}" for name in missing)
        return package_xml[:at] + lines + package_xml[at:]
    end = _PACKAGE_END.search(package_xml)
    if end is None:
        return package_xml
    lines = "".join(f"{end[1]}  {_exec_depend(name)}{newline}" for name in missing)
    return package_xml[: end.start()] + lines + package_xml[end.start() :]


def _parse(text: str) -> ElementTree.Element | None:
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return None


def _exec_depend(name: str) -> str:
    return f"<exec_depend>{name}</exec_depend>"
