"""Check `folders`: whether obk can write its runs, caches and temporary files. Creates nothing."""

import os
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import GIB, MIB, Fact, Finding, bytes_text, ok, warning
from obk_cli.doctor.memory import write_fault
from obk_cli.runs.folder import runs_folder
from obk_cli.workspace.model_cache import cache_folder

__all__ = ["FolderFacts", "judge_folders", "probe_folders"]


ENOUGH_BYTES: Final = GIB
LEAST_BYTES: Final = 100 * MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderFacts:
    """One folder that obk writes to."""

    purpose: str
    """What is kept there."""
    folder: str | None
    """None: the user has no place for it."""
    fault: str
    """Why nothing can be written there; empty: it can."""
    free_bytes: int
    mover: str
    """The variable that puts the folder elsewhere."""


def judge_folders(folders: tuple[FolderFacts, ...]) -> Iterator[Finding]:
    """Each folder that obk writes to."""
    for facts in folders:
        move = f"export {facts.mover}=/a/folder/with/room"
        measured: dict[str, Fact] = {"folder": facts.folder, "free_bytes": facts.free_bytes}
        if facts.folder is None:
            yield warning(f"no folder is available for {facts.purpose}", move)
        elif facts.fault:
            yield warning(f"{facts.purpose}: {facts.folder}: {facts.fault}", move, **measured)
        elif facts.free_bytes < ENOUGH_BYTES:
            much = "almost full" if facts.free_bytes < LEAST_BYTES else "filling up"
            yield warning(
                f"{facts.purpose}: the disk of {facts.folder} is {much}, "
                f"{bytes_text(facts.free_bytes)} free",
                f"du -sh {facts.folder}    # or: {move}",
                **measured,
            )
        else:
            yield ok(
                f"{facts.purpose}: {facts.folder}, {bytes_text(facts.free_bytes)} free", **measured
            )


def probe_folders(environment: Mapping[str, str]) -> tuple[FolderFacts, ...]:
    """Measure each folder, or its nearest existing parent."""
    return (
        _facts("runs and their logs", runs_folder(environment), "OBK_HOME"),
        _facts("the cache of models", cache_folder(environment), "XDG_CACHE_HOME"),
        _facts("temporary files", Path(tempfile.gettempdir()), "TMPDIR"),
    )


def _facts(purpose: str, folder: Path | None, mover: str) -> FolderFacts:
    if folder is None:
        return FolderFacts(purpose=purpose, folder=None, fault="", free_bytes=0, mover=mover)
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    is_folder = existing.is_dir()
    space = os.statvfs(existing)
    return FolderFacts(
        purpose=purpose,
        folder=str(folder),
        fault=write_fault(existing) if is_folder else f"{existing} is a file",
        free_bytes=space.f_frsize * space.f_bavail,
        mover=mover,
    )
