"""Is there room in shared memory for what DDS puts there? Facts in, findings out."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from obk_cli.doctor.finding import Fact, Finding, note, ok, warning
from obk_cli.doctor.sizes import MIB, told_bytes

__all__ = ["SharedMemoryFacts", "judge_shared_memory"]

WANTED_BYTES: Final = 64 * MIB
"""A node takes about half a MiB, a camera's images many."""
MANY_FILES: Final = 500
GROW: Final = (
    "sudo mount -o remount,size=512M /dev/shm    # a container: docker run --shm-size=512m"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedMemoryFacts:
    """The folder /dev/shm."""

    total_bytes: int | None
    """None: there is no such folder."""
    free_bytes: int
    fault: str
    """Why a file cannot be made there; empty: it can."""
    dds_files: int
    """Files of Fast DDS in it, of all users."""


def judge_shared_memory(facts: SharedMemoryFacts) -> Iterator[Finding]:
    """Whether processes can exchange messages through it."""
    if facts.total_bytes is None:
        yield warning(
            "there is no /dev/shm: messages go over the network stack, which is slower",
            "sudo mount -t tmpfs -o size=512M tmpfs /dev/shm",
        )
        return
    told = f"/dev/shm has {told_bytes(facts.free_bytes)} of {told_bytes(facts.total_bytes)} free"  # noqa: S108
    sizes: dict[str, Fact] = {"total_bytes": facts.total_bytes, "free_bytes": facts.free_bytes}
    if facts.fault:
        yield warning(
            f"nothing can be written to /dev/shm: {facts.fault}; DDS does without, slower",
            "sudo mount -o remount,rw /dev/shm && sudo chmod 1777 /dev/shm",
            **sizes,
        )
    elif facts.free_bytes < WANTED_BYTES:
        cure = GROW if facts.total_bytes < 2 * WANTED_BYTES else "obk reap"
        yield warning(f"{told}; DDS wants {told_bytes(WANTED_BYTES)} or more", cure, **sizes)
    else:
        yield ok(told, **sizes)
    if facts.dds_files > MANY_FILES:
        yield note(
            f"{facts.dds_files} files of Fast DDS are in /dev/shm, most of them of killed nodes",
            "obk reap",
            dds_files=facts.dds_files,
        )
