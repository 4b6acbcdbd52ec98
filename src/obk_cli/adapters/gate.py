"""The gate that holds nodes back which were started early (see `obelisk_spec.runtime_protocol`)."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

__all__ = ["closed_gate", "gate_path"]

NAME: Final = ".gate"


def gate_path(folder: Path) -> Path:
    """The gate of a run, in its folder."""
    return folder / NAME


@contextmanager
def closed_gate(folder: Path) -> Iterator[None]:
    """While entered, no program of the run that waits at its gate makes a node.

    Raises:
        OSError: the folder takes no file.
    """
    gate = os.open(gate_path(folder), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(gate, fcntl.LOCK_EX)
        yield
    finally:
        os.close(gate)
