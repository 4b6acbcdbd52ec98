"""The shared libraries of a package: their sources, their dependencies and their translation units.

Generated sources are many and small and include the same large headers: one unit with all sources
of a library and language compiles three times as fast as one unit for each source.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.package import TYPE_SUPPORTS, PackageTree

__all__ = ["Library", "libraries_of", "object_of", "write_units"]

_BASE = ("rosidl_runtime_c", "rcutils")


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """One shared library; `package` is None for a C library and the owner of a Python module."""

    file: str
    sources: tuple[Path, ...]
    links: tuple[str, ...]
    forced_links: tuple[str, ...] = ()
    package: str | None = None


def libraries_of(tree: PackageTree, dependencies: Iterable[str]) -> tuple[Library, ...]:
    """Return the libraries of a package in the order in which they are linked.

    `dependencies` are all the interface packages that the package may refer to.
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
) -> Library:
    own = () if part == "rosidl_generator_c" else (f"{tree.package.name}__rosidl_generator_c",)
    return Library(
        file=f"lib{tree.package.name}__{part}.so",
        sources=tuple(sources),
        links=(*own, *links, *_BASE),
    )


def _details(tree: PackageTree, generator: str, suffix: str) -> tuple[Path, ...]:
    code = tree.code_of(generator)
    return tuple(code / i.kind / "detail" / f"{i.stem}__{suffix}" for i in tree.package.interfaces)


def _generator_c(tree: PackageTree, dependencies: tuple[str, ...]) -> Library:
    part = "rosidl_generator_c"
    suffixes = ("description.c", "functions.c", "type_support.c")
    files = (file for suffix in suffixes for file in _details(tree, part, suffix))
    # The last of the three is written for services and actions only.
    sources = (f for f in files if not f.name.endswith("__type_support.c") or f.is_file())
    return _library(tree, part, sources, _of(dependencies, part))


def _fastrtps(tree: PackageTree, dependencies: tuple[str, ...]) -> Library:
    part = TYPE_SUPPORTS[0]
    links = (
        *_of(dependencies, part),
        *_of(dependencies, "rosidl_generator_c"),
        *(part, "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw"),
    )
    return _library(tree, part, _details(tree, part, "type_support_c.cpp"), links)


def _introspection(tree: PackageTree, dependencies: tuple[str, ...]) -> Library:
    part = TYPE_SUPPORTS[1]
    links = (*_of(dependencies, part), *_of(dependencies, "rosidl_generator_c"), part)
    return _library(tree, part, _details(tree, part, "type_support.c"), links)


def _typesupport_c(tree: PackageTree, dependencies: tuple[str, ...]) -> Library:
    part = "rosidl_typesupport_c"
    code = tree.code_of(part)
    sources = (code / i.kind / f"{i.stem}__type_support.cpp" for i in tree.package.interfaces)
    return _library(tree, part, sources, (*_of(dependencies, part), part))


def _generator_py(tree: PackageTree, dependencies: tuple[str, ...]) -> Library:
    part = "rosidl_generator_py"
    sources = (tree.python / i.kind / f"_{i.stem}_s.c" for i in tree.package.interfaces)
    links = (*_of(dependencies, part), *_of(dependencies, "rosidl_generator_c"))
    return _library(tree, part, sources, links)


def _module(tree: PackageTree) -> Library:
    """Return the Python extension module of the package.

    librosidl_typesupport_c opens the type supports by bare name. Linking the module with them has
    them loaded by then, so that they are found although their folder is on no search path.
    """
    name = tree.package.name
    own = ("rosidl_generator_py", "rosidl_typesupport_c", "rosidl_generator_c")
    return Library(
        file=f"{name}_s__rosidl_typesupport_c.so",
        sources=(tree.python / f"_{name}_s.ep.rosidl_typesupport_c.c",),
        links=(*(f"{name}__{part}" for part in own), *_BASE),
        forced_links=_of((name,), TYPE_SUPPORTS[0]) + _of((name,), TYPE_SUPPORTS[1]),
        package=name,
    )


# Sources of this ending define file-local names that clash with each other's.
_ALONE = "__description.c"
# Two of the generated sources' own macros are defined in each file.
_SEPARATOR = "#undef STRINGIFY\n#undef STRINGIFY_\n"


def write_units(library: Library, folder: Path) -> tuple[Path, ...]:
    """Write the unity sources of a library into a folder; return everything to be compiled."""
    alone = [source for source in library.sources if source.name.endswith(_ALONE)]
    together = [source for source in library.sources if not source.name.endswith(_ALONE)]
    units = [*alone]
    for suffix in sorted({source.suffix for source in together}):
        unit = folder / f"{Path(library.file).stem}.unity{suffix}"
        members = (source for source in together if source.suffix == suffix)
        text = _SEPARATOR.join(f'#include "{member}"\n' for member in members)
        unit.write_text(text, encoding="utf-8")
        units.append(unit)
    return tuple(units)


def object_of(library: Library, unit: Path, folder: Path) -> Path:
    """Return the object file of a unit; the digest keeps equal file names apart."""
    digest = hashlib.sha256(str(unit).encode()).hexdigest()[:8]
    return folder / f"{Path(library.file).stem}.{digest}.o"
