"""The folder /dev/shm: its size, and whether a file can be made there."""

import os
import tempfile
from pathlib import Path
from typing import Final

from obk_cli.doctor.memory import SharedMemoryFacts

__all__ = ["probe_shared_memory"]

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
