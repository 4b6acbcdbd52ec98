"""Turns of tests that would meet in what a host has only once, whichever process runs them."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["turn_of_leftovers"]


@contextmanager
def turn_of_leftovers() -> Iterator[None]:
    """While entered, no other test leaves processes behind, or ends all that were left."""
    path = Path(tempfile.gettempdir(), f"obk-tests-leftovers-{os.getuid()}.lock")
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
