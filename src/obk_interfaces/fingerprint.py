"""Tells whether a package would be built into the same thing again.

In go everything a build depends on; out comes a digest. Never writes, and looks for no compiler
unless it is given one.
"""

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

from obk_interfaces.package import InterfacePackage
from obk_interfaces.prefix import Prefixes
from obk_interfaces.toolchain import Toolchain

__all__ = ["digest_of", "fingerprint_of"]


def fingerprint_of(package: InterfacePackage, prefixes: Prefixes, toolchain: Toolchain) -> str:
    """Digest what `digest_of` does, and the compiler."""
    words = (digest_of(package, prefixes), *toolchain.cc, *toolchain.cxx)
    return hashlib.sha256(b"\0".join(word.encode() for word in words)).hexdigest()


def digest_of(
    package: InterfacePackage, prefixes: Prefixes, *, built_with: Iterable[str] = ()
) -> str:
    """Digest the package, what it refers to, this engine, the Python and the ROS.

    `built_with` are digests of packages that it refers to and that no prefix has.
    """
    digest = hashlib.sha256()
    for word in (sys.version, str(prefixes.ros), *built_with):
        digest.update(word.encode() + b"\0")
    files = [package.root / "package.xml", *(package.root / i.file for i in package.interfaces)]
    for file in (*files, *_files_of_dependencies(package, prefixes), *_files_of_engine()):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _files_of_dependencies(package: InterfacePackage, prefixes: Prefixes) -> Iterable[Path]:
    for _, share in sorted(prefixes.closure(package).items()):
        yield from sorted(share.glob("*/*.idl"))


def _files_of_engine() -> Iterable[Path]:
    return sorted(Path(__file__).parent.glob("*.py"))
