"""Read, use and replace the overlay of compiled messages, `<workspace>/.obk/overlay`.

The overlay is a symbolic link. A new one is built beside it from hard links, then the link is
replaced, so that no process sees an incomplete overlay.
"""

import fcntl
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from obk_cli.errors import CommandFailedError
from obk_cli.files import is_untrusted, write_text

__all__ = [
    "FOLDER",
    "RECORD",
    "Builder",
    "BuiltPackage",
    "OverlayRecord",
    "build_folder",
    "build_lock",
    "import_from",
    "new_overlay",
    "overlay_folder",
    "overlay_prefixes",
    "read_record",
    "replace_overlay",
    "underlays_of",
    "with_overlays",
]

Builder = Literal["obk", "colcon"]

FOLDER: Final = ".obk"
"""Folder in a workspace with everything that `obk build` creates."""
RECORD: Final = "overlay.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPackage:
    """One package of an overlay."""

    source: str
    """Its folder, relative to the workspace."""
    digest: str
    """Digest of everything that it was built from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlayRecord:
    """The description of an overlay in its `overlay.json`."""

    builder: Builder
    python: str
    ros: str
    """The ROS 2 that it was built against."""
    prefixes: tuple[str, ...]
    """Where the packages are installed; `.` is the overlay itself."""
    packages: Mapping[str, BuiltPackage]


def overlay_folder(workspace: Path) -> Path:
    """The path of a workspace's overlay, which may not exist."""
    return workspace / FOLDER / "overlay"


def build_folder(workspace: Path) -> Path:
    """The folder for build results; kept, so that unchanged packages are not rebuilt."""
    return workspace / FOLDER / "build"


def read_record(workspace: Path) -> OverlayRecord | None:
    """The record of the overlay; None if it is missing, unreadable or another user's."""
    if is_untrusted(workspace / FOLDER):
        return None
    try:
        record = json.loads((overlay_folder(workspace) / RECORD).read_bytes())
        import msgspec  # only if there is an overlay, to keep `obk validate` fast

        return msgspec.convert(record, OverlayRecord)
    except (OSError, ValueError, RecursionError):
        return None


def overlay_prefixes(workspaces: Iterable[Path]) -> tuple[Path, ...]:
    """The prefixes of the workspaces' overlays, in the order of the workspaces."""
    found: list[Path] = []
    for workspace in workspaces:
        record = read_record(workspace)
        if record is not None and record.packages:
            found += (
                Path(os.path.normpath(overlay_folder(workspace) / p)) for p in record.prefixes
            )
    return tuple(dict.fromkeys(found))


def with_overlays(variables: Mapping[str, str], overlays: Sequence[Path]) -> dict[str, str]:
    """The variables of a process that searches these prefixes first, the nearest one first."""
    before: dict[str, list[Path]] = {
        "AMENT_PREFIX_PATH": [*overlays],
        "LD_LIBRARY_PATH": [prefix / "lib" for prefix in overlays],
        "PYTHONPATH": [*_python_folders(overlays)],
        # Read at startup by every Python of this environment, even without PYTHONPATH.
        "OBK_OVERLAY_PATH": [*overlays],
    }
    merged = dict(variables)
    for name, folders in before.items():
        inherited = (entry for entry in variables.get(name, "").split(":") if entry)
        if entries := dict.fromkeys((*map(str, folders), *inherited)):
            merged[name] = ":".join(entries)
    return merged


def import_from(overlays: Sequence[Path]) -> None:
    """Let this process import the packages of overlays; already imported ones are kept."""
    folders = [str(folder) for folder in _python_folders(overlays)]
    sys.path[:0] = [folder for folder in folders if folder not in sys.path]


def underlays_of(environment: Mapping[str, str], overlays: Iterable[Path]) -> tuple[Path, ...]:
    """The prefixes below the overlays: those on AMENT_PREFIX_PATH, then this Python's."""
    own = {prefix.resolve() for prefix in overlays}
    listed = environment.get("AMENT_PREFIX_PATH", "").split(":")
    prefixes = dict.fromkeys(Path(prefix) for prefix in (*listed, sys.prefix) if prefix)
    return tuple(prefix for prefix in prefixes if prefix.resolve() not in own)


def _python_folders(prefixes: Iterable[Path]) -> Iterable[Path]:
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    for prefix in prefixes:
        # colcon installs into the second one with Debian's Python.
        places = (
            Path("lib", version, "site-packages"),
            Path("local/lib", version, "dist-packages"),
        )
        yield from (prefix / place for place in places if (prefix / place).is_dir())


STAGE: Final = "overlay-"
ABOUT: Final = "Message packages of this workspace, compiled by `obk build`. May be deleted."
SETUP: Final = """\
# For programs that `obk` does not start: . .obk/setup.sh
export OBK_OVERLAY_PATH="{overlay}${{OBK_OVERLAY_PATH:+:$OBK_OVERLAY_PATH}}"
"""
TURN_S: Final = 900.0
"""Limit for another build [s]."""
POLL_S: Final = 0.05


def new_overlay(workspace: Path, *, with_current: bool) -> Path:
    """Create the folder of a new overlay; `with_current` links the content of the current one."""
    folder = Path(tempfile.mkdtemp(dir=workspace / FOLDER, prefix=STAGE))
    folder.chmod(0o755)
    now = overlay_folder(workspace)
    if with_current and now.is_dir():
        # Hard links are safe, because no file of a prefix is ever written in place.
        shutil.copytree(now, folder, dirs_exist_ok=True, copy_function=os.link)
    return folder


def replace_overlay(workspace: Path, folder: Path, record: OverlayRecord) -> None:
    """Make a new folder the overlay, and remove the old one."""
    (folder / RECORD).unlink(missing_ok=True)  # a hard link to the old one's
    data = {"about": ABOUT, "workspace": str(workspace), **asdict(record)}
    write_text(folder / RECORD, json.dumps(data, indent=1) + "\n")
    link = overlay_folder(workspace)
    write_text(link.parent / "setup.sh", SETUP.format(overlay=link))
    moved = link.with_name(f"{link.name}.new")
    moved.unlink(missing_ok=True)
    moved.symlink_to(folder.name)
    moved.replace(link)
    _remove_others(workspace, folder)


def _remove_others(workspace: Path, kept: Path) -> None:
    for folder in (workspace / FOLDER).glob(f"{STAGE}*"):
        if folder.name != kept.name:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def build_lock(workspace: Path, on_wait: Callable[[str], None]) -> Iterator[None]:
    """Hold the exclusive right to build in a workspace; waits for another build to end.

    `on_wait` is called once with the build that it waits for. Leftovers of an interrupted build are
    removed.

    Raises:
        CommandFailedError: the workspace cannot be written or has another user's overlay, or the
            other build does not end.
    """
    folder = workspace / FOLDER
    if is_untrusted(folder):
        raise CommandFailedError(
            f"{folder} belongs to another user", help="move the packages to a folder of your own"
        )
    try:
        folder.mkdir(exist_ok=True)
        write_text(folder / ".gitignore", "# Created by `obk build`.\n*\n")
        file = (folder / "build.lock").open("a+")
    except OSError as error:
        raise CommandFailedError(
            f"the workspace {workspace} cannot be written: {error.strerror}",
            help="message packages are compiled into the folder `.obk` of their workspace",
        ) from error
    with file:
        _wait(file.fileno(), folder / "build.lock", on_wait)
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        _remove_others(workspace, overlay_folder(workspace).resolve())
        yield


def _wait(descriptor: int, path: Path, on_wait: Callable[[str], None]) -> None:
    deadline = time.monotonic() + TURN_S
    has_reported = False
    while True:
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        owner = path.read_text().strip()
        who = f"process {owner}" if owner else "another process"
        if not has_reported:
            on_wait(f"waiting for {who}, which is building in this workspace")
            has_reported = True
        if time.monotonic() > deadline:
            raise CommandFailedError(
                f"{who} has been building for {TURN_S / 60:g} min", help="stop it if it hangs"
            )
        time.sleep(POLL_S)
