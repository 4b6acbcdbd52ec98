"""The folders that obk writes to: whether it can, and how much room there is.

Makes none of them.
"""

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from obk_cli.adapters.model_cache import cache_folder
from obk_cli.adapters.probes.shared_memory import write_fault
from obk_cli.doctor.folders import FolderFacts
from obk_cli.runs.folder import runs_folder

__all__ = ["probe_folders"]


def probe_folders(environment: Mapping[str, str]) -> tuple[FolderFacts, ...]:
    """Each folder, by what stands of its path so far."""
    return (
        _facts("runs and their logs", runs_folder(environment), "OBK_HOME"),
        _facts("the cache of models", cache_folder(environment), "XDG_CACHE_HOME"),
        _facts("temporary files", Path(tempfile.gettempdir()), "TMPDIR"),
    )


def _facts(purpose: str, folder: Path | None, mover: str) -> FolderFacts:
    if folder is None:
        return FolderFacts(purpose=purpose, folder=None, fault="", free_bytes=0, mover=mover)
    standing = next(path for path in (folder, *folder.parents) if path.exists())
    is_folder = standing.is_dir()
    space = os.statvfs(standing)
    return FolderFacts(
        purpose=purpose,
        folder=str(folder),
        fault=write_fault(standing) if is_folder else f"{standing} is a file",
        free_bytes=space.f_frsize * space.f_bavail,
        mover=mover,
    )
