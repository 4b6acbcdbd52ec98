"""Read interface packages, order them by dependency, and locate the folders of a build.

In the build root of a package, `generated/` has a folder per rosidl generator, because two of them
write files of the same name. `objects/` has the compiler's output, and `install/` is the finished
prefix. This module does not read the text of message definitions.
"""

import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Protocol, TypeVar
from xml.parsers.expat import ErrorString

from obk_interfaces.errors import DependencyError, PackageError

__all__ = [
    "C_GENERATORS",
    "KINDS",
    "TYPE_SUPPORTS",
    "Interface",
    "InterfacePackage",
    "PackageTree",
    "cmake_calls",
    "definition_files",
    "discover",
    "load_package",
    "missing_definitions",
    "order_by_dependency",
    "read_depends",
]

KINDS = ("msg", "srv", "action")
_DEPEND_TAGS = ("depend", "build_depend", "build_export_depend", "exec_depend")
_STANDARD = frozenset(
    "action_msgs builtin_interfaces composition_interfaces diagnostic_msgs geometry_msgs "
    "lifecycle_msgs nav_msgs rcl_interfaces rosgraph_msgs sensor_msgs service_msgs shape_msgs "
    "statistics_msgs std_msgs std_srvs stereo_msgs tf2_msgs trajectory_msgs unique_identifier_msgs "
    "visualization_msgs".split()
)
"""Packages in every ROS 2 installation; definitions may use them without a declaration."""
_USED_TYPE = re.compile(r"^\s*([a-z]\w*)/(?:msg/)?[A-Z]", re.MULTILINE)
_CMAKE_COMMENT = re.compile(r"#\[(=*)\[.*?\]\1\]|#[^\n]*", re.DOTALL)
_CMAKE_CALL = re.compile(r"\b([A-Za-z_]\w*)\s*\(([^()]*)\)")
_CMAKE_VARIABLE = re.compile(r"\$\{(\w+)\}")
_CMAKE_DEFINITION = re.compile(r"(msg|srv|action)/\w+\.\1")
_CMAKE_OPTIONS = frozenset({"ADD_LINTER_TESTS", "LIBRARY_NAME", "SKIP_GROUP_MEMBERSHIP_CHECK"})
_IGNORE_MARKERS = ("COLCON_IGNORE", "AMENT_IGNORE")


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Interface:
    """A definition file: `kind` is msg, srv or action, `name` its name without suffix."""

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
        """The kinds of definitions in this package."""
        return tuple(k for k in KINDS if any(i.kind == k for i in self.interfaces))


def discover(paths: Iterable[Path]) -> tuple[InterfacePackage, ...]:
    """Find all interface packages under the paths, dependencies first.

    Raises:
        PackageError: a path or manifest does not exist or cannot be read, two packages have the
            same name, or no interface package is found.
        DependencyError: the packages depend on each other in a cycle.
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
                f"two packages have the name {package.name}: {other.root} and {package.root}"
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
        PackageError: the manifest cannot be read, or the package has no definitions.
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
            raise PackageError(f"{root / interface.file}: not a regular file")
    if not interfaces:
        raise PackageError(f"{root}: no definitions in msg/, srv/ or action/")
    name = _required_text(document, "name", manifest)
    depends = {*_depends(document), *_depends_elsewhere(root, interfaces)} - {name}
    return InterfacePackage(
        root=root.resolve(),
        name=name,
        version=_required_text(document, "version", manifest),
        depends=tuple(sorted(depends)),
        interfaces=interfaces,
    )


def _depends_elsewhere(root: Path, interfaces: Iterable[Interface]) -> frozenset[str]:
    """Return dependencies that the manifest may lack: CMake's, and the standard packages in use.

    A `find_package` counts if a definition uses a type of that package.
    """
    files = (root / interface.file for interface in interfaces)
    texts = (file.read_text(encoding="utf-8", errors="replace") for file in files)
    used = {name for text in texts for name in _USED_TYPE.findall(text)}
    found, generated = _cmake_depends(_cmake_text(root))
    return generated | (used & (found | _STANDARD))


def _cmake_text(root: Path) -> str:
    try:
        return (root / "CMakeLists.txt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def missing_definitions(root: Path) -> tuple[str, ...]:
    """Return the definitions in a package's CMakeLists.txt that do not exist: `msg/Gone.msg`.

    CMake cannot build the package with them. Names with variables are not checked.
    """
    text = _cmake_text(root)
    return tuple(
        word
        for command, words in cmake_calls(text)
        if command == "rosidl_generate_interfaces"
        for word in words
        if _CMAKE_DEFINITION.fullmatch(word) and word in text and not (root / word).exists()
    )


def _cmake_depends(text: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the packages that a CMakeLists.txt finds, and those that its definitions depend on."""
    found: set[str] = set()
    generated: set[str] = set()
    for command, words in cmake_calls(text):
        if command == "find_package":
            found.update(words[:1])
        elif command == "rosidl_generate_interfaces" and "DEPENDENCIES" in words:
            named = words[words.index("DEPENDENCIES") + 1 :]
            generated.update(takewhile(lambda word: word not in _CMAKE_OPTIONS, named))
    return frozenset(found), frozenset(generated)


def cmake_calls(text: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the commands of a CMakeLists.txt, in lower case, with their arguments.

    Variables that the file itself sets, and PROJECT_NAME, are expanded; nothing is run.
    """
    variables: dict[str, str] = {}
    for call in _CMAKE_CALL.finditer(_CMAKE_COMMENT.sub("", text)):
        filled = _CMAKE_VARIABLE.sub(lambda name: variables.get(name[1], ""), call[2])
        words = tuple(filled.replace('"', " ").replace(";", " ").split())
        command = call[1].lower()
        if command == "set" and words:
            variables[words[0]] = " ".join(words[1:])
        elif command == "project" and words:
            variables["PROJECT_NAME"] = words[0]
        yield command, words


def definition_files(root: Path, kind: str) -> Iterator[Path]:
    """Find the definitions of a kind in a package, ignoring hidden files, which editors write."""
    files = (root / kind).glob(f"*.{kind}")
    return (file for file in files if not file.name.startswith("."))


def read_depends(manifest: Path) -> tuple[str, ...]:
    """Return the sorted names of the packages that a manifest depends on.

    Raises:
        PackageError: the manifest cannot be read.
    """
    return _depends(_read_manifest(manifest))


def _manifests(paths: Iterable[Path]) -> Iterable[Path]:
    for base in paths:
        if not base.is_dir():
            raise PackageError(f"folder not found: {base}")
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
        fault = f"unsupported encoding ({error}), use UTF-8"
        raise PackageError(f"{path}:1:1: {fault}") from error


def _required_text(document: ET.Element, tag: str, path: Path) -> str:
    text = (document.findtext(tag) or "").strip()
    if not text:
        raise PackageError(f"{path}: <{tag}> is missing or empty")
    return text


def _depends(document: ET.Element) -> tuple[str, ...]:
    names = (e.text or "" for tag in _DEPEND_TAGS for e in document.iter(tag))
    return tuple(sorted({name.strip() for name in names} - {""}))


class _Dependent(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def depends(self) -> tuple[str, ...]: ...


_P = TypeVar("_P", bound=_Dependent)


def order_by_dependency(packages: Iterable[_P]) -> tuple[_P, ...]:
    """Order packages by dependency, then by name.

    Dependencies on packages that are not given are ignored.

    Raises:
        DependencyError: packages depend on each other in a cycle; the message names them.
    """
    waiting = {p.name: p for p in sorted(packages, key=lambda p: p.name)}
    ordered: list[_P] = []
    while waiting:
        ready = next((p for p in waiting.values() if waiting.keys().isdisjoint(p.depends)), None)
        if ready is None:
            raise DependencyError("packages depend on each other: " + _cycle(waiting))
        ordered.append(waiting.pop(ready.name))
    return tuple(ordered)


def _cycle(waiting: dict[str, _P]) -> str:
    """Follow unresolved dependencies from the first package until a name repeats."""
    trail = [next(iter(waiting))]
    while trail[-1] not in trail[:-1]:
        trail.append(next(name for name in waiting[trail[-1]].depends if name in waiting))
    return " -> ".join(trail[trail.index(trail[-1]) :])


# rclpy needs these at runtime with rmw_fastrtps_cpp. The introspection type support cannot be left
# out: the middleware creates the type objects for discovery from it.
TYPE_SUPPORTS = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
C_GENERATORS = ("rosidl_generator_c", "rosidl_typesupport_c", *TYPE_SUPPORTS)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageTree:
    """Build folders of one package under `root`."""

    package: InterfacePackage
    root: Path

    @property
    def generated(self) -> Path:
        """The output of the generators, and their argument files."""
        return self.root / "generated"

    @property
    def objects(self) -> Path:
        """Unity sources and object files."""
        return self.root / "objects"

    @property
    def install(self) -> Path:
        """The finished prefix: `lib/`, `include/`, `share/`."""
        return self.root / "install"

    @property
    def share(self) -> Path:
        """Definitions and their translations, before installation."""
        return self.generated / "share" / self.package.name

    @property
    def python(self) -> Path:
        """The generated Python package."""
        return self.generated / "python" / self.package.name

    @property
    def fingerprint(self) -> Path:
        """File with the digest of a finished build's inputs; written last."""
        return self.root / "fingerprint"

    def code_of(self, generator: str) -> Path:
        """Return the folder that a C generator writes to; its parent is an include folder."""
        return self.generated / generator / self.package.name

    def clear(self) -> None:
        """Empty the folders for a new build."""
        self.fingerprint.unlink(missing_ok=True)
        for folder in (self.generated, self.objects, self.install):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
