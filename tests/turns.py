"""Locks for tests that need a resource of the host exclusively, across processes."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["turn_of_leftovers"]


@contextmanager
def turn_of_leftovers() -> Iterator[None]:
    """Inside the `with` block, no other test leaves orphans or kills all orphans."""
    path = Path(tempfile.gettempdir(), f"obk-tests-leftovers-{os.getuid()}.lock")
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
