"""Replacing the overlay of a workspace: one at a time, and as a whole.

The overlay is a link. A new one is made beside it, and the link is moved in one step, so that
whoever looks sees the old one or the new one and never half of one.
"""

import fcntl
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

from obk_cli.adapters.overlay import FOLDER, RECORD, OverlayRecord, overlay_folder
from obk_cli.adapters.planted import is_planted
from obk_cli.errors import CommandFailedError
from obk_cli.files import write_text

__all__ = ["build_turn", "new_overlay", "replace_overlay"]

STAGE: Final = "overlay-"
ABOUT: Final = "Message packages of this workspace, compiled by `obk build`. May be deleted."
SETUP: Final = """\
# For programs that `obk` does not start: . .obk/setup.sh
export OBK_OVERLAY_PATH="{overlay}${{OBK_OVERLAY_PATH:+:$OBK_OVERLAY_PATH}}"
"""
TURN_S: Final = 900.0
"""How long another build may take [s]."""
POLL_S: Final = 0.05


def new_overlay(workspace: Path, *, as_now: bool) -> Path:
    """A folder that is to become the overlay; `as_now`: with what the present one holds."""
    folder = Path(tempfile.mkdtemp(dir=workspace / FOLDER, prefix=STAGE))
    folder.chmod(0o755)
    now = overlay_folder(workspace)
    if as_now and now.is_dir():
        # Links, as no file of a prefix is ever written in place.
        shutil.copytree(now, folder, dirs_exist_ok=True, copy_function=os.link)
    return folder


def replace_overlay(workspace: Path, folder: Path, record: OverlayRecord) -> None:
    """Have a new folder be the overlay from now on, and remove the old one."""
    (folder / RECORD).unlink(missing_ok=True)  # a link to the old one's
    told = {"about": ABOUT, "workspace": str(workspace), **asdict(record)}
    write_text(folder / RECORD, json.dumps(told, indent=1) + "\n")
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
def build_turn(workspace: Path, on_wait: Callable[[str], None]) -> Iterator[None]:
    """Hold the one right to build in a workspace; waits for another build to end.

    `on_wait` hears once who is waited for. What a build left behind that did not come to its end
    is removed.

    Raises:
        CommandFailedError: the workspace cannot be written or has another user's overlay, or the
            other build does not end.
    """
    folder = workspace / FOLDER
    if is_planted(folder):
        raise CommandFailedError(
            f"{folder} is another user's", help="keep the packages in a folder of your own"
        )
    try:
        folder.mkdir(exist_ok=True)
        write_text(folder / ".gitignore", "# Made by `obk build`.\n*\n")
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
    has_told = False
    while True:
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        owner = path.read_text().strip()
        who = f"process {owner}" if owner else "another process"
        if not has_told:
            on_wait(f"{who} builds in this workspace; waiting for it")
            has_told = True
        if time.monotonic() > deadline:
            raise CommandFailedError(
                f"{who} has been building for {TURN_S / 60:g} min", help="end it if it hangs"
            )
        time.sleep(POLL_S)
