"""Can runs and caches be kept? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Fact, Finding, ok, warning
from obk_cli.doctor.sizes import GIB, MIB, told_bytes

__all__ = ["FolderFacts", "judge_folders"]

WANTED_BYTES: Final = GIB
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
        told: dict[str, Fact] = {"folder": facts.folder, "free_bytes": facts.free_bytes}
        if facts.folder is None:
            yield warning(f"there is no place for {facts.purpose}", move)
        elif facts.fault:
            yield warning(f"{facts.purpose}: {facts.folder}: {facts.fault}", move, **told)
        elif facts.free_bytes < WANTED_BYTES:
            much = "almost full" if facts.free_bytes < LEAST_BYTES else "filling up"
            yield warning(
                f"{facts.purpose}: the disk of {facts.folder} is {much}, "
                f"{told_bytes(facts.free_bytes)} free",
                f"du -sh {facts.folder}    # or: {move}",
                **told,
            )
        else:
            yield ok(
                f"{facts.purpose}: {facts.folder}, {told_bytes(facts.free_bytes)} free", **told
            )
