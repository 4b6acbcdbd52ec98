"""List the shared libraries of a package: sources, dependencies and translation units.

The generated sources are many small files that include the same large headers. One unit with all
sources of a library and language compiles three times as fast as one unit for each source.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.package import TYPE_SUPPORTS, PackageTree

__all__ = ["SharedLibrary", "libraries_of", "object_of", "write_units"]

_BASE = ("rosidl_runtime_c", "rcutils")


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedLibrary:
    """A shared library; `package` is the package of a Python module, None for a C library."""

    file: str
    sources: tuple[Path, ...]
    links: tuple[str, ...]
    forced_links: tuple[str, ...] = ()
    package: str | None = None


def libraries_of(tree: PackageTree, dependencies: Iterable[str]) -> tuple[SharedLibrary, ...]:
    """Return the libraries of a package in link order.

    `dependencies` are all interface packages that the package may refer to.
    """
    dependencies = tuple(dependencies)
    return (
        _generator_c(tree, dependencies),
        _fastrtps(tree, dependencies),
        _introspection(tree, dependencies),
        _typesupport_c(tree, dependencies),
        _generator_py(tree, dependencies),
        _module(tree),
    )


def _of(names: Iterable[str], part: str) -> tuple[str, ...]:
    return tuple(f"{name}__{part}" for name in names)


def _library(
    tree: PackageTree, part: str, sources: Iterable[Path], links: tuple[str, ...]
) -> SharedLibrary:
    own = () if part == "rosidl_generator_c" else (f"{tree.package.name}__rosidl_generator_c",)
    return SharedLibrary(
        file=f"lib{tree.package.name}__{part}.so",
        sources=tuple(sources),
        links=(*own, *links, *_BASE),
    )


def _details(tree: PackageTree, generator: str, suffix: str) -> tuple[Path, ...]:
    code = tree.code_of(generator)
    return tuple(code / i.kind / "detail" / f"{i.stem}__{suffix}" for i in tree.package.interfaces)


def _generator_c(tree: PackageTree, dependencies: tuple[str, ...]) -> SharedLibrary:
    part = "rosidl_generator_c"
    suffixes = ("description.c", "functions.c", "type_support.c")
    files = (file for suffix in suffixes for file in _details(tree, part, suffix))
    # The generators write the last of the three only for services and actions.
    sources = (f for f in files if not f.name.endswith("__type_support.c") or f.is_file())
    return _library(tree, part, sources, _of(dependencies, part))


def _fastrtps(tree: PackageTree, dependencies: tuple[str, ...]) -> SharedLibrary:
    part = TYPE_SUPPORTS[0]
    links = (
        *_of(dependencies, part),
        *_of(dependencies, "rosidl_generator_c"),
        *(part, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw"),
    )
    return _library(tree, part, _details(tree, part, "type_support_c.cpp"), links)


def _introspection(tree: PackageTree, dependencies: tuple[str, ...]) -> SharedLibrary:
    part = TYPE_SUPPORTS[1]
    links = (*_of(dependencies, part), *_of(dependencies, "rosidl_generator_c"), part)
    return _library(tree, part, _details(tree, part, "type_support.c"), links)


def _typesupport_c(tree: PackageTree, dependencies: tuple[str, ...]) -> SharedLibrary:
    part = "rosidl_typesupport_c"
    code = tree.code_of(part)
    sources = (code / i.kind / f"{i.stem}__type_support.cpp" for i in tree.package.interfaces)
    return _library(tree, part, sources, (*_of(dependencies, part), part))


def _generator_py(tree: PackageTree, dependencies: tuple[str, ...]) -> SharedLibrary:
    part = "rosidl_generator_py"
    sources = (tree.python / i.kind / f"_{i.stem}_s.c" for i in tree.package.interfaces)
    links = (*_of(dependencies, part), *_of(dependencies, "rosidl_generator_c"))
    return _library(tree, part, sources, links)


def _module(tree: PackageTree) -> SharedLibrary:
    """Return the Python extension module of the package.

    librosidl_typesupport_c opens the type supports by bare name. The module is linked with them, so
    they are already loaded by then and are found although their folder is on no search path.
    """
    name = tree.package.name
    own = ("rosidl_generator_py", "rosidl_typesupport_c", "rosidl_generator_c")
    return SharedLibrary(
        file=f"{name}_s__rosidl_typesupport_c.so",
        sources=(tree.python / f"_{name}_s.ep.rosidl_typesupport_c.c",),
        links=(*(f"{name}__{part}" for part in own), *_BASE),
        forced_links=_of((name,), TYPE_SUPPORTS[0]) + _of((name,), TYPE_SUPPORTS[1]),
        package=name,
    )


# Sources with this ending define file-local names that clash in one unit.
_SEPARATE = "__description.c"
# Each generated file defines these two macros.
_DELIMITER = "#undef STRINGIFY\n#undef STRINGIFY_\n"


def write_units(library: SharedLibrary, folder: Path) -> tuple[Path, ...]:
    """Write the unity sources of a library into a folder; return all files to compile."""
    separate = [source for source in library.sources if source.name.endswith(_SEPARATE)]
    together = [source for source in library.sources if not source.name.endswith(_SEPARATE)]
    units = [*separate]
    for suffix in sorted({source.suffix for source in together}):
        unit = folder / f"{Path(library.file).stem}.unity{suffix}"
        members = (source for source in together if source.suffix == suffix)
        text = _DELIMITER.join(f'#include "{member}"\n' for member in members)
        unit.write_text(text, encoding="utf-8")
        units.append(unit)
    return tuple(units)


def object_of(library: SharedLibrary, unit: Path, folder: Path) -> Path:
    """Return the object file of a unit; the digest makes equal file names unique."""
    digest = hashlib.sha256(str(unit).encode()).hexdigest()[:8]
    return folder / f"{Path(library.file).stem}.{digest}.o"
