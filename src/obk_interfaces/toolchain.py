"""The shared libraries of a package, and the compiler and linker commands that build them.

The generated sources are many small files that include the same large headers. One unit with all
sources of a library and language compiles three times as fast as one unit per source.

Only this module reads `CC` and `CXX`; it runs no compiler. The libraries contain no paths of the
build machine: run paths are relative, and file names in messages are relative to the build root.
"""

import hashlib
import importlib
import os
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.errors import BuildToolError
from obk_interfaces.package import C_GENERATORS, TYPE_SUPPORTS, PackageTree
from obk_interfaces.prefix import Prefixes, include_folders, site_packages_in

__all__ = [
    "SharedLibrary",
    "Toolchain",
    "compile_command",
    "find_compilers",
    "find_python_headers",
    "find_toolchain",
    "include_flags",
    "libraries_of",
    "library_path",
    "link_command",
    "object_of",
    "write_units",
]


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
    they are loaded by then and are found although their folder is on no search path.
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


# Sources with this suffix define file-local names that clash in a single unit.
_SEPARATE = "__description.c"
# Every generated file defines these two macros.
_DELIMITER = "#undef STRINGIFY\n#undef STRINGIFY_\n"


def write_units(library: SharedLibrary, folder: Path) -> tuple[Path, ...]:
    """Write the unity sources of a library to a folder, and return all files to compile."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Toolchain:
    """Commands for C and C++, and the header folders that every unit needs."""

    cc: tuple[str, ...]
    cxx: tuple[str, ...]
    includes: tuple[Path, ...]


def find_toolchain() -> Toolchain:
    """Find the compilers and headers for an extension module of this Python.

    Raises:
        BuildToolError: something is missing; the message says what to install.
    """
    cc, cxx = find_compilers()
    return Toolchain(cc=cc, cxx=cxx, includes=(*find_python_headers(), _numpy_include()))


def find_compilers() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the commands for C and C++.

    Raises:
        BuildToolError: a compiler is not installed.
    """
    return (
        _compiler("CC", "C", ("gcc", "cc", "clang")),
        _compiler("CXX", "C++", ("g++", "c++", "clang++")),
    )


def _compiler(variable: str, language: str, usual: tuple[str, ...]) -> tuple[str, ...]:
    chosen = os.environ.get(variable)
    candidates = (tuple(shlex.split(chosen)),) if chosen else tuple((name,) for name in usual)
    for command in candidates:
        if command and shutil.which(command[0]):
            return command
    tried = f"{variable}={chosen}" if chosen else ", ".join(usual)
    raise BuildToolError(
        f"no {language} compiler found ({tried}): install one "
        "(Debian, Ubuntu: apt install g++; Fedora: dnf install gcc-c++)"
    )


def find_python_headers() -> tuple[Path, ...]:
    """Return the folders of `Python.h` and `pyconfig.h`.

    Raises:
        BuildToolError: the headers are not installed.
    """
    paths = sysconfig.get_paths()
    candidates = (paths["include"], paths["platinclude"], sysconfig.get_config_var("INCLUDEPY"))
    found = (Path(c) for c in dict.fromkeys(candidates) if c and Path(c, "Python.h").is_file())
    if includes := tuple(found):
        return includes
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    raise BuildToolError(
        f"the headers of Python {version} (Python.h) are not in {paths['include']}: install them "
        f"(Debian, Ubuntu: apt install python{version}-dev; Fedora: dnf install python3-devel)"
    )


def _numpy_include() -> Path:
    try:
        numpy = importlib.import_module("numpy")
    except ImportError as error:
        raise BuildToolError("numpy is not installed", fix="pip install 'numpy>=2'") from error
    return Path(numpy.get_include())


# -w: users cannot fix warnings in generated sources.
_FLAGS = ("-O1", "-fPIC", "-DNDEBUG", "-w")


def include_flags(tree: PackageTree, prefixes: Prefixes, toolchain: Toolchain) -> tuple[str, ...]:
    """Return the include flags of a package's sources, its own headers first."""
    own = (tree.generated / generator for generator in C_GENERATORS)
    folders = (*own, *include_folders(prefixes.all), *toolchain.includes)
    return tuple(f"-I{folder}" for folder in folders)


def compile_command(
    unit: Path, target: Path, *, tree: PackageTree, includes: Sequence[str], toolchain: Toolchain
) -> tuple[str, ...]:
    """Return the command that compiles one unit."""
    is_cpp = unit.suffix == ".cpp"
    return (
        *(toolchain.cxx if is_cpp else toolchain.cc),
        "-std=c++17" if is_cpp else "-std=gnu11",
        *_FLAGS,
        f"-ffile-prefix-map={tree.root}=.",
        *includes,
        *("-c", str(unit), "-o", str(target)),
    )


def library_path(library: SharedLibrary, prefix: Path) -> Path:
    """Return the path of a library in a prefix."""
    if library.package:
        return site_packages_in(prefix) / library.package / library.file
    return prefix / "lib" / library.file


def link_command(
    library: SharedLibrary,
    objects: Sequence[Path],
    *,
    tree: PackageTree,
    prefixes: Prefixes,
    toolchain: Toolchain,
) -> tuple[str, ...]:
    """Return the command that links one library into the package's own prefix."""
    run_path = "$ORIGIN/../../.." if library.package else "$ORIGIN"
    soname = () if library.package else (f"-Wl,-soname,{library.file}",)
    folders = (prefix / "lib" for prefix in (tree.install, *prefixes.all))
    return (
        *(*toolchain.cxx, "-shared", "-o", str(library_path(library, tree.install))),
        *map(str, objects),
        *soname,
        *("-Wl,-s", "-Wl,--as-needed", f"-Wl,-rpath,{run_path}"),
        *(f"-L{folder}" for folder in folders),
        *(f"-l{name}" for name in library.links),
        "-Wl,--no-as-needed",
        *(f"-l{name}" for name in library.forced_links),
    )
