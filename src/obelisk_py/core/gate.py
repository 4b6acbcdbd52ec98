"""Waits until the launcher lets nodes be made, where it started this process before that."""

import fcntl
import os

from obelisk_spec.runtime_protocol import GATE_VARIABLE

__all__ = ["wait_at_gate"]


def wait_at_gate() -> None:
    """Return when the gate is open, or at once where there is none."""
    path = os.environ.get(GATE_VARIABLE)
    if path is None:
        return
    try:
        gate = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:  # the folder of the run was cleared since; a restart comes late
        return
    try:
        fcntl.flock(gate, fcntl.LOCK_SH)
    finally:
        os.close(gate)
