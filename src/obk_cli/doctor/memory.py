"""Check `shared-memory`: room in /dev/shm, where DDS keeps messages."""

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import MIB, Fact, Finding, bytes_text, note, ok, warning

__all__ = ["SharedMemoryFacts", "judge_shared_memory", "probe_shared_memory"]


LEAST_BYTES: Final = 64 * MIB
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
            "no folder /dev/shm: messages take the slower network stack",
            "sudo mount -t tmpfs -o size=512M tmpfs /dev/shm",
        )
        return
    room = f"/dev/shm has {bytes_text(facts.free_bytes)} of {bytes_text(facts.total_bytes)} free"  # noqa: S108
    sizes: dict[str, Fact] = {"total_bytes": facts.total_bytes, "free_bytes": facts.free_bytes}
    if facts.fault:
        yield warning(
            f"cannot write to /dev/shm: {facts.fault}; DDS uses a slower transport",
            "sudo mount -o remount,rw /dev/shm && sudo chmod 1777 /dev/shm",
            **sizes,
        )
    elif facts.free_bytes < LEAST_BYTES:
        cure = GROW if facts.total_bytes < 2 * LEAST_BYTES else "obk reap"
        yield warning(f"{room}; DDS needs at least {bytes_text(LEAST_BYTES)}", cure, **sizes)
    else:
        yield ok(room, **sizes)
    if facts.dds_files > MANY_FILES:
        yield note(
            f"{facts.dds_files} Fast DDS files are in /dev/shm, most of them left by killed nodes",
            "obk reap",
            dds_files=facts.dds_files,
        )


FOLDER: Final = Path("/dev/shm")  # noqa: S108 - where DDS has it


def probe_shared_memory(folder: Path = FOLDER) -> SharedMemoryFacts:
    """Measure it."""
    if not folder.is_dir():
        return SharedMemoryFacts(total_bytes=None, free_bytes=0, fault="", dds_files=0)
    space = os.statvfs(folder)
    return SharedMemoryFacts(
        total_bytes=space.f_frsize * space.f_blocks,
        free_bytes=space.f_frsize * space.f_bavail,
        fault=write_fault(folder),
        dds_files=sum(1 for _ in folder.glob("fastrtps_*")),
    )


def write_fault(folder: Path) -> str:
    """Why no file can be written into a folder, empty if one can; it is gone again."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"obk doctor")
            file.flush()
    except OSError as fault:
        return fault.strerror or str(fault)
    return ""
