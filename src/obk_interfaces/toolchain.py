"""Find compilers and headers, and write the command lines of the compiler and the linker.

Only this module reads `CC` and `CXX`; it runs no compiler. The libraries contain no path of the
build machine: run paths are relative, and file names in messages start at the build root.
"""

import importlib
import os
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.errors import BuildToolError
from obk_interfaces.libraries import SharedLibrary
from obk_interfaces.package import C_GENERATORS, PackageTree
from obk_interfaces.prefix import Prefixes, include_folders, site_packages_in

__all__ = [
    "Toolchain",
    "compile_command",
    "find_compilers",
    "find_python_headers",
    "find_toolchain",
    "include_flags",
    "library_path",
    "link_command",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Toolchain:
    """Commands for C and C++, and the header folders that every unit needs."""

    cc: tuple[str, ...]
    cxx: tuple[str, ...]
    includes: tuple[Path, ...]


def find_toolchain() -> Toolchain:
    """Find the compilers and headers for an extension module of this Python.

    Raises:
        BuildToolError: something is missing; the text names what to install.
    """
    cc, cxx = find_compilers()
    return Toolchain(cc=cc, cxx=cxx, includes=(*find_python_headers(), _numpy_include()))


def find_compilers() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the commands for C and for C++.

    Raises:
        BuildToolError: one of them is not installed.
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
        raise BuildToolError("numpy is not installed: pip install 'numpy>=2'") from error
    return Path(numpy.get_include())


# -w: the sources are generated; no user can fix their warnings.
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
