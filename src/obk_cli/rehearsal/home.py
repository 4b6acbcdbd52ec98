"""Where a rehearsal keeps its runs: in its own folder, so that no other run's logs give way."""

import shutil
from pathlib import Path
from typing import Final

from obk_cli.adapters.clock import local_time
from obk_cli.errors import CommandFailedError
from obk_cli.runs.folder import make_run_folder, run_folders
from obk_cli.runs.registry import live_folders

__all__ = ["make_home"]

KEPT: Final = 10
"""Rehearsals whose logs stay."""


def make_home(parent: Path, name: str) -> Path:
    """Make the folder of a new rehearsal, and remove the oldest ones.

    Args:
        parent: of all rehearsals.
        name: the config's.

    Raises:
        CommandFailedError: it cannot be made.
    """
    try:
        home = make_run_folder(parent, name, local_time())
    except OSError as error:
        raise CommandFailedError(f"a rehearsal keeps logs, and cannot here: {error}") from error
    for old in run_folders(parent)[KEPT:]:
        if not live_folders(old / "runs"):
            shutil.rmtree(old, ignore_errors=True)
    return home
