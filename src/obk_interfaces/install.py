"""Puts the parts of a package together as a prefix, and copies finished prefixes.

Files are replaced, never written in place: a running process keeps the library it has loaded.
"""

import filecmp
import shutil
from pathlib import Path

from obk_interfaces.prefix import site_packages_in
from obk_interfaces.tree import C_GENERATORS, PackageTree

__all__ = ["assemble", "install_into", "is_installed", "remove_package"]


def assemble(tree: PackageTree) -> None:
    """Copy everything but the libraries from the generated tree to the package's prefix."""
    name = tree.package.name
    shutil.copytree(tree.share, tree.install / "share" / name)
    for generator in C_GENERATORS:
        _copy(tree.code_of(generator), tree.install / "include" / name / name, "*.h")
    _copy(tree.python, site_packages_in(tree.install) / name, "*.py")
    (tree.install / "lib").mkdir(exist_ok=True)
    _write_index(tree)


def _copy(source: Path, target: Path, pattern: str) -> None:
    for file in source.rglob(pattern):
        copy = target / file.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)


def _write_index(tree: PackageTree) -> None:
    """Write the package's entries in the ament index."""
    package = tree.package
    definitions = sorted(file for i in package.interfaces for file in {i.file, i.idl})
    resources = {
        "packages": "",
        "rosidl_interfaces": "\n".join(definitions),
        "package_run_dependencies": ";".join(package.depends),
    }
    for resource, text in resources.items():
        entry = tree.install / "share" / "ament_index" / "resource_index" / resource / package.name
        entry.parent.mkdir(parents=True)
        entry.write_text(text, encoding="utf-8")


def is_installed(tree: PackageTree, prefix: Path) -> bool:
    """Say whether every file of the package's prefix is in another prefix, with equal bytes."""
    return all(
        (copy := prefix / file.relative_to(tree.install)).is_file()
        and filecmp.cmp(file, copy, shallow=False)
        for file in tree.install.rglob("*")
        if file.is_file()
    )


def install_into(tree: PackageTree, prefix: Path) -> None:
    """Replace what a prefix has of this package by the finished build."""
    remove_package(tree.package.name, prefix)
    shutil.copytree(tree.install, prefix, dirs_exist_ok=True)


def remove_package(name: str, prefix: Path) -> None:
    """Remove what a prefix has of a package."""
    owned = (prefix / "share" / name, prefix / "include" / name, site_packages_in(prefix) / name)
    for folder in owned:
        shutil.rmtree(folder, ignore_errors=True)
    for library in (prefix / "lib").glob(f"lib{name}__*.so"):
        library.unlink()
    for entry in (prefix / "share" / "ament_index" / "resource_index").glob(f"*/{name}"):
        entry.unlink()
