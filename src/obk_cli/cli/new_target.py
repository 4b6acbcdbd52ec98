"""Which folder a new node goes into: a package of its own, or the package that is there.

In: `--dest` and the working folder. Out: the folder and, if it is a package, its identity.
Never writes.
"""

from dataclasses import dataclass
from pathlib import Path

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.package_xml import PackageIdentity, read_identity

__all__ = ["Place", "find_place", "find_root", "read_text"]

_ELSEWHERE = "use --dest to make a package of its own somewhere else"


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A folder for packages, or a package that takes the node in.

    `boundary` is the folder that the user spoke of; nothing is made outside it.
    """

    folder: Path
    boundary: Path
    package: PackageIdentity | None = None


def find_place(dest: Path | None) -> Place:
    """`dest`; without it `src/` of the working folder if there is one, else the working folder.

    Raises:
        CommandFailedError: it is a package, and one that cannot take a Python node.
    """
    folder = Path() if dest is None else dest
    if (folder / "package.xml").is_file():
        return Place(folder=folder, boundary=folder, package=_identify(folder))
    if dest is None and Path("src").is_dir():
        return Place(folder=Path("src"), boundary=folder)
    return Place(folder=folder, boundary=folder)


def find_root(place: Place, name: str) -> Path:
    """The folder of the package that the node of that (checked) name goes into.

    Raises:
        CommandFailedError: it is a file, or is reached through a symbolic link that leads out.
    """
    if place.package is not None:
        return place.folder.resolve()
    root = place.folder / name
    real = root.resolve()
    if not real.is_relative_to(place.boundary.resolve()):
        raise CommandFailedError(
            f"{root} is reached through a symbolic link that leads to {real}",
            help=f"to make the package there, say so: --dest {real.parent}",
        )
    if root.exists() and not root.is_dir():
        raise CommandFailedError(
            f"{root} is a file; a folder was to be made",
            help="choose another name or --dest",
        )
    return root


def read_text(path: Path) -> str:
    """The text with its line ends as they are; empty where there is no such file.

    Raises:
        CommandFailedError: it is not UTF-8.
    """
    try:
        return path.read_bytes().decode() if path.is_file() else ""
    except UnicodeDecodeError as fault:
        raise CommandFailedError(f"{path} is not UTF-8 text: {fault}", help=_ELSEWHERE) from fault


def _identify(folder: Path) -> PackageIdentity:
    identity = read_identity(read_text(folder / "package.xml"))
    if identity is None:
        raise CommandFailedError(
            f"{folder / 'package.xml'} is no package.xml that can be read", help=_ELSEWHERE
        )
    if identity.build_type != "ament_python":
        raise CommandFailedError(
            f"the package `{identity.name}` here has the build type `{identity.build_type}`; "
            "a Python node can be added to a package of build type `ament_python`",
            help=_ELSEWHERE,
        )
    if not (folder / identity.name / "__init__.py").is_file():
        raise CommandFailedError(
            f"the package `{identity.name}` here has no module `{identity.name}/__init__.py`",
            help=f"make that file, or {_ELSEWHERE}",
        )
    return identity
