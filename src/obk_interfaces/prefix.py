"""Find packages in prefixes, assemble a package's prefix, and install and remove packages.

Files are replaced, never written in place, so a running process keeps the library that it has
loaded.
"""

import filecmp
import importlib.util
import shutil
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.errors import BuildToolError, NoRosError
from obk_interfaces.package import C_GENERATORS, KINDS, InterfacePackage, PackageTree, read_depends

__all__ = [
    "Prefixes",
    "assemble",
    "find_ros_prefix",
    "include_folders",
    "install_into",
    "is_installed",
    "remove_package",
    "site_packages_in",
]

_IMPLICIT = {
    "msg": (),
    "srv": ("service_msgs", "builtin_interfaces"),
    "action": ("action_msgs", "unique_identifier_msgs", "service_msgs", "builtin_interfaces"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Prefixes:
    """Installed trees, nearest first; `ros` has the generators and is always last."""

    layers: tuple[Path, ...]
    ros: Path

    @property
    def all(self) -> tuple[Path, ...]:
        """Every prefix once, nearest first."""
        return tuple(dict.fromkeys((*self.layers, self.ros)))

    def above(self, layer: Path) -> "Prefixes":
        """Return the same prefixes with one more in front."""
        return Prefixes(layers=(layer, *self.layers), ros=self.ros)

    def share_of(self, package: str) -> Path | None:
        """Return the share folder of an installed package, or None."""
        shares = (prefix / "share" / package for prefix in self.all)
        return next((share for share in shares if (share / "package.xml").is_file()), None)

    def interface_share_of(self, package: str) -> Path | None:
        """Return the share folder of an installed interface package, or None."""
        share = self.share_of(package)
        return share if share and any((share / kind).is_dir() for kind in KINDS) else None

    def closure(self, package: InterfacePackage) -> dict[str, Path]:
        """Return the share folder of every interface package that this one may refer to."""
        implicit = (name for kind in package.kinds for name in _IMPLICIT[kind])
        todo = [*package.depends, *implicit]
        closure: dict[str, Path] = {}
        while todo:
            name = todo.pop(0)
            share = self.interface_share_of(name)
            if share is None or name in closure or name == package.name:
                continue
            closure[name] = share
            todo += _installed_depends(share)
        return closure


def _installed_depends(share: Path) -> tuple[str, ...]:
    """Return an installed package's dependencies, from its manifest and from the ament index."""
    index = share.parent / "ament_index" / "resource_index" / "package_run_dependencies"
    try:
        listed = (index / share.name).read_text(encoding="utf-8").strip().split(";")
    except OSError:
        listed = []
    return (*read_depends(share / "package.xml"), *(name for name in listed if name))


def find_ros_prefix() -> Path:
    """Return the prefix of the importable ROS 2 generators.

    It cannot be `sys.prefix`, which differs in a build environment, and which is the virtual
    environment if ROS 2 is sourced.

    Raises:
        NoRosError: the generators cannot be imported.
        BuildToolError: they have no templates.
    """
    spec = importlib.util.find_spec("rosidl_generator_c")
    if spec is None or spec.origin is None:
        raise NoRosError(
            f"{sys.executable} cannot import the ROS 2 message generators, because ROS 2 is "
            "neither installed there nor sourced"
        )
    origin = Path(spec.origin)
    for prefix in origin.parents:
        if (prefix / "share" / "rosidl_generator_c" / "resource").is_dir():
            return prefix
    raise BuildToolError(
        f"{origin.parent} has no share/rosidl_generator_c above it: "
        "this installation of the ROS 2 message generators is incomplete"
    )


def site_packages_in(prefix: Path) -> Path:
    """Return the folder for Python packages in a prefix."""
    return prefix / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"


def include_folders(prefixes: Iterable[Path]) -> tuple[Path, ...]:
    """Return the header folders of the prefixes: `include/` and each `include/X` that has `X/X`."""
    found: list[Path] = []
    for include in (prefix / "include" for prefix in prefixes):
        if include.is_dir():
            nested = (d for d in sorted(include.iterdir()) if (d / d.name).is_dir())
            found += [include, *nested]
    return tuple(dict.fromkeys(found))


def assemble(tree: PackageTree) -> None:
    """Copy everything except the libraries from the generated tree to the package's prefix."""
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
    """Whether another prefix has every file of the package's prefix with the same content."""
    return all(
        (copy := prefix / file.relative_to(tree.install)).is_file()
        and filecmp.cmp(file, copy, shallow=False)
        for file in tree.install.rglob("*")
        if file.is_file()
    )


def install_into(tree: PackageTree, prefix: Path) -> None:
    """Replace the package's files in a prefix with those of the finished build."""
    remove_package(tree.package.name, prefix)
    shutil.copytree(tree.install, prefix, dirs_exist_ok=True)


def remove_package(name: str, prefix: Path) -> None:
    """Remove a package's files from a prefix."""
    owned = (prefix / "share" / name, prefix / "include" / name, site_packages_in(prefix) / name)
    for folder in owned:
        shutil.rmtree(folder, ignore_errors=True)
    for library in (prefix / "lib").glob(f"lib{name}__*.so"):
        library.unlink()
    for entry in (prefix / "share" / "ament_index" / "resource_index").glob(f"*/{name}"):
        entry.unlink()
