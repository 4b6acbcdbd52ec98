"""The folders that one package is built in.

`generated/` holds what the rosidl generators wrote, one folder each (two of them write files of
the same name); `objects/` what the compiler wrote; `install/` the finished prefix of the package.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

from obk_interfaces.package import InterfacePackage

__all__ = ["C_GENERATORS", "TYPE_SUPPORTS", "PackageTree"]

# What rclpy needs at run time with rmw_fastrtps_cpp. The introspection type support looks
# dispensable but is not: the middleware makes the type objects of discovery from it.
TYPE_SUPPORTS = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
C_GENERATORS = ("rosidl_generator_c", "rosidl_typesupport_c", *TYPE_SUPPORTS)


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageTree:
    """Build folders of one package below `root`."""

    package: InterfacePackage
    root: Path

    @property
    def generated(self) -> Path:
        """Everything that the generators write, and their arguments."""
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
        """Definitions and their translations, before they are installed."""
        return self.generated / "share" / self.package.name

    @property
    def python(self) -> Path:
        """The generated Python package."""
        return self.generated / "python" / self.package.name

    @property
    def fingerprint(self) -> Path:
        """Written last: what the finished build was made from."""
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
