"""The command lines of the compiler and the linker.

Pure: values in, lists of words out. No path of the building machine gets into what they make:
run paths are relative to the library, and file names in messages are mapped to nothing.
"""

from collections.abc import Sequence
from pathlib import Path

from obk_interfaces.libraries import Library
from obk_interfaces.prefix import Prefixes, include_folders, site_packages_in
from obk_interfaces.toolchain import Toolchain
from obk_interfaces.tree import C_GENERATORS, PackageTree

__all__ = ["compile_command", "include_flags", "link_command", "output_of"]

# -w: the sources are generated; their warnings are nobody's to mend.
_FLAGS = ("-O1", "-fPIC", "-DNDEBUG", "-w")


def include_flags(tree: PackageTree, prefixes: Prefixes, toolchain: Toolchain) -> tuple[str, ...]:
    """Return the header folders of a package's sources, its own first."""
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


def output_of(library: Library, prefix: Path) -> Path:
    """Return where a library is installed in a prefix."""
    if library.package:
        return site_packages_in(prefix) / library.package / library.file
    return prefix / "lib" / library.file


def link_command(
    library: Library,
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
        *(*toolchain.cxx, "-shared", "-o", str(output_of(library, tree.install))),
        *map(str, objects),
        *soname,
        *("-Wl,-s", "-Wl,--as-needed", f"-Wl,-rpath,{run_path}"),
        *(f"-L{folder}" for folder in folders),
        *(f"-l{name}" for name in library.links),
        "-Wl,--no-as-needed",
        *(f"-l{name}" for name in library.forced_links),
    )
