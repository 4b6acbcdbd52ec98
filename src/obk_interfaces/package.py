"""Finds interface packages on disk and reads their manifests.

In go folders; out come `InterfacePackage` values in the order in which they must be built.
Never writes, and never reads the message definitions themselves.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.parsers.expat import ErrorString

from obk_interfaces.errors import PackageError
from obk_interfaces.order import order_by_dependency

__all__ = [
    "KINDS",
    "Interface",
    "InterfacePackage",
    "definition_files",
    "discover",
    "load_package",
    "read_depends",
]

KINDS = ("msg", "srv", "action")
_DEPEND_TAGS = ("depend", "build_depend", "build_export_depend", "exec_depend")
_IGNORE_MARKERS = ("COLCON_IGNORE", "AMENT_IGNORE")


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Interface:
    """One definition file: `kind` is msg, srv or action, `name` its name without suffix."""

    kind: str
    name: str

    @property
    def file(self) -> str:
        """Path inside the package, such as `msg/JointState.msg`."""
        return f"{self.kind}/{self.name}.{self.kind}"

    @property
    def idl(self) -> str:
        """Path of the translated definition, such as `msg/JointState.idl`."""
        return f"{self.kind}/{self.name}.idl"

    @property
    def stem(self) -> str:
        """Name of the generated sources, such as `joint_state`."""
        split = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", self.name)
        return re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", split).lower()


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfacePackage:
    """A ROS 2 package with message definitions; `root` is absolute."""

    root: Path
    name: str
    version: str
    depends: tuple[str, ...]
    interfaces: tuple[Interface, ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of definitions that this package has."""
        return tuple(k for k in KINDS if any(i.kind == k for i in self.interfaces))


def discover(paths: Iterable[Path]) -> tuple[InterfacePackage, ...]:
    """Find every interface package below the paths, dependencies first.

    Raises:
        PackageError: a path or a manifest is not there or cannot be read, one name is used by
            two packages, or there is no interface package at all.
        DependencyError: the packages need one another in a circle.
    """
    paths = tuple(paths)
    found: dict[str, InterfacePackage] = {}
    for manifest in _manifests(paths):
        if not any(manifest.parent.joinpath(kind).is_dir() for kind in KINDS):
            continue
        package = load_package(manifest.parent)
        other = found.setdefault(package.name, package)
        if other.root != package.root:
            raise PackageError(
                f"two packages are called {package.name}: {other.root} and {package.root}"
            )
    if not found:
        listing = ", ".join(map(str, paths))
        raise PackageError(
            f"no interface package under {listing}: "
            "expected a folder with package.xml and msg/, srv/ or action/"
        )
    return order_by_dependency(found.values())


def load_package(root: Path) -> InterfacePackage:
    """Read one package folder.

    Raises:
        PackageError: the manifest cannot be read, or there are no definitions.
    """
    manifest = root / "package.xml"
    document = _read_manifest(manifest)
    interfaces = tuple(
        sorted(
            Interface(kind=kind, name=file.stem)
            for kind in KINDS
            for file in definition_files(root, kind)
        )
    )
    for interface in interfaces:
        if not (root / interface.file).is_file():
            raise PackageError(f"{root / interface.file}: is no file, as a definition is")
    if not interfaces:
        raise PackageError(f"{root}: has msg/, srv/ or action/, but no definition in it")
    return InterfacePackage(
        root=root.resolve(),
        name=_required_text(document, "name", manifest),
        version=_required_text(document, "version", manifest),
        depends=_depends(document),
        interfaces=interfaces,
    )


def definition_files(root: Path, kind: str) -> Iterator[Path]:
    """Find the definitions of a kind in a package; hidden files, as editors leave, are none."""
    files = (root / kind).glob(f"*.{kind}")
    return (file for file in files if not file.name.startswith("."))


def read_depends(manifest: Path) -> tuple[str, ...]:
    """Return the names that a manifest depends on, sorted.

    Raises:
        PackageError: the manifest cannot be read.
    """
    return _depends(_read_manifest(manifest))


def _manifests(paths: Iterable[Path]) -> Iterable[Path]:
    for base in paths:
        if not base.is_dir():
            raise PackageError(f"no such folder: {base}")
        for manifest in sorted(base.resolve().rglob("package.xml")):
            if not _is_ignored(manifest.parent):
                yield manifest


def _is_ignored(folder: Path) -> bool:
    return any(
        (level / marker).exists()
        for level in (folder, *folder.parents)
        for marker in _IGNORE_MARKERS
    )


def _read_manifest(path: Path) -> ET.Element:
    try:
        return ET.parse(path).getroot()
    except OSError as error:
        raise PackageError(f"{path}: cannot be read: {error.strerror}") from error
    except ET.ParseError as error:
        line, column = error.position
        fault = ErrorString(error.code)
        raise PackageError(f"{path}:{line}:{column + 1}: not well-formed XML: {fault}") from error
    except (LookupError, ValueError) as error:
        fault = f"the encoding that it names cannot be read ({error}), UTF-8 can"
        raise PackageError(f"{path}:1:1: {fault}") from error


def _required_text(document: ET.Element, tag: str, path: Path) -> str:
    text = (document.findtext(tag) or "").strip()
    if not text:
        raise PackageError(f"{path}: has no <{tag}>")
    return text


def _depends(document: ET.Element) -> tuple[str, ...]:
    names = (e.text or "" for tag in _DEPEND_TAGS for e in document.iter(tag))
    return tuple(sorted({name.strip() for name in names} - {""}))
