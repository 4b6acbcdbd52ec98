"""The lines of a log file, and those that come to it."""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

__all__ = ["follow_lines", "last_lines", "read_lines"]

POLL_S: Final = 0.1
_BLOCK: Final = 1 << 15
"""Read at once from behind, where the last lines are wanted [bytes]."""
_MOST: Final = 1 << 20
"""Of the last lines: what the longest may have in all [bytes]."""


def read_lines(path: Path) -> Iterator[str]:
    """The lines of a file, without their ends; none where there is no file.

    Raises:
        OSError: it is there and cannot be read.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            yield from (line.rstrip("\n") for line in file)
    except FileNotFoundError:
        return


def last_lines(path: Path, count: int) -> tuple[str, ...]:
    """The last lines of a file, however long it is; fewer where they have 1 MiB and more.

    Raises:
        OSError: it is there and cannot be read.
    """
    try:
        with path.open("rb") as file:
            begin = file.seek(0, os.SEEK_END)
            data = b""
            # One line end more than lines: what stands before the first is not whole.
            while begin > 0 and data.count(b"\n") <= count and len(data) < _MOST:
                size = min(_BLOCK, begin)
                begin -= size
                file.seek(begin)
                data = file.read(size) + data
    except FileNotFoundError:
        return ()
    lines = data.decode(errors="replace").removesuffix("\n").split("\n") if data else []
    whole = lines[1:] if begin else lines
    return tuple(whole[max(0, len(whole) - count) :])


def follow_lines(path: Path) -> Iterator[str | None]:
    """The lines of a file, then those that come, without end; None each time that it waits.

    Waits for a file that is not there yet, and goes on with one that takes its place.

    Raises:
        OSError: it is there and cannot be read.
    """
    while True:
        try:
            with path.open("rb") as file:
                yield from _of_one_file(path, file)
        except FileNotFoundError:
            yield None
            time.sleep(POLL_S)


def _of_one_file(path: Path, file: IO[bytes]) -> Iterator[str | None]:
    """Lines until another file has the name, or this one was cut short."""
    begun = b""
    while True:
        # Asked before reading: what was written before the file was replaced is still read.
        is_current = _is_current(path, file)
        while piece := file.readline():
            begun += piece
            if begun.endswith(b"\n"):
                yield begun[:-1].decode(errors="replace")
                begun = b""
        if not is_current:
            if begun:
                yield begun.decode(errors="replace")
            return
        yield None
        time.sleep(POLL_S)


def _is_current(path: Path, file: IO[bytes]) -> bool:
    opened = os.fstat(file.fileno())
    try:
        named = path.stat()
    except FileNotFoundError:
        return False
    is_same = (named.st_dev, named.st_ino) == (opened.st_dev, opened.st_ino)
    return is_same and named.st_size >= os.lseek(file.fileno(), 0, os.SEEK_CUR)
