"""Which folder a new node goes into: a package of its own, or the package that is there.

In: the name, `--dest`, the working folder. Out: the folder and, if it is a package, its identity.
Never writes.
"""

from dataclasses import dataclass
from pathlib import Path

from obk_cli.errors import CommandFailedError
from obk_cli.scaffold.package_xml import PackageIdentity, read_identity

__all__ = ["Target", "find_target", "read_text"]

_ELSEWHERE = "use --dest to make a package of its own somewhere else"


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Where the node goes; `package` is set where the folder is a package already."""

    root: Path
    package: PackageIdentity | None


def find_target(name: str, dest: Path | None) -> Target:
    """The folder for a node of that (checked) name.

    Without `dest` it is `src/` of the working folder if there is one, else the working folder;
    a folder that is a package takes the node in.

    Raises:
        CommandFailedError: the folder is a package that cannot take a Python node, is a file, or
            is reached through a symbolic link that leads out.
    """
    folder = Path() if dest is None else dest
    if (folder / "package.xml").is_file():
        return Target(root=folder.resolve(), package=_identify(folder))
    if dest is None and Path("src").is_dir():
        folder = Path("src")
    root = folder / name
    _refuse_way_out(root, inside=Path() if dest is None else dest)
    if root.exists() and not root.is_dir():
        raise CommandFailedError(f"{root} is a file; a folder was to be made", help="try --dest")
    return Target(root=root, package=None)


def read_text(path: Path) -> str:
    """The text with its line ends as they are; empty where there is no such file.

    Raises:
        CommandFailedError: it is not UTF-8.
    """
    try:
        return path.read_bytes().decode() if path.is_file() else ""
    except UnicodeDecodeError as fault:
        raise CommandFailedError(f"{path} is not UTF-8 text: {fault}", help=_ELSEWHERE) from fault


def _refuse_way_out(root: Path, *, inside: Path) -> None:
    real = root.resolve()
    if real.is_relative_to(inside.resolve()):
        return
    raise CommandFailedError(
        f"{root} is reached through a symbolic link that leads to {real}",
        help=f"to make the package there, say so: --dest {real.parent}",
    )


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
