"""Read user files, explain file-system errors, and recognize files that other users own."""

import os
import stat
import sys
from pathlib import Path
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.source import LONGEST_FILE_BYTES

__all__ = [
    "STANDARD_INPUT",
    "explain_os_error",
    "is_planted",
    "is_within_planted",
    "read_bytes",
    "unwritable",
]

STANDARD_INPUT = "-"
_MOST_BYTES = LONGEST_FILE_BYTES + 1


def read_bytes(path: str) -> bytes | str:
    """What a file holds, or why it cannot be read; `-` is the standard input.

    Of one that is longer than any config no more than shows that.
    """
    try:
        if path == STANDARD_INPUT:
            # It is None where whoever started this has closed it.
            return sys.stdin.buffer.read(_MOST_BYTES) if sys.stdin else "it is closed"
        if _is_named_pipe(Path(path)):
            return "it is a named pipe"
        with Path(path).open("rb") as file:
            return file.read(_MOST_BYTES)
    except (OSError, ValueError) as error:
        return explain_os_error(error)


def _is_named_pipe(path: Path) -> bool:
    """Whether opening it would wait for somebody; the pipes of a shell have a writer."""
    return path.is_fifo() and not path.resolve().is_relative_to("/proc")


def explain_os_error(error: OSError | ValueError) -> str:
    """The system's error in the user's words."""
    match error:
        case FileNotFoundError():
            return "there is no such file"
        case IsADirectoryError():
            return "it is a folder"
        case PermissionError():
            return "it may not be read"
        case OSError(strerror=str() as text):
            return text.lower()
    return str(error)


def unwritable(path: Path, error: OSError) -> CommandFailedError:
    """What a command ends with that cannot write its file."""
    reason = explain_os_error(error)
    if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
        reason = f"the folder {path.parent} is not there"
    elif isinstance(error, PermissionError):
        reason = "it may not be written"
    return CommandFailedError(f"`{path}` cannot be written: {reason}")


FOR_EVERYBODY: Final = stat.S_ISVTX | stat.S_IWOTH
"""Of a folder where each user may put something, and take away nobody else's."""


def is_planted(path: Path) -> bool:
    """Whether it lies in such a folder and is neither this user's nor root's.

    What a user keeps beside it would otherwise be run with it.
    """
    try:
        owner, mode = path.lstat().st_uid, path.parent.stat().st_mode
    except OSError:
        return False
    return owner not in (os.geteuid(), 0) and mode & FOR_EVERYBODY == FOR_EVERYBODY


def is_within_planted(path: Path) -> bool:
    """Whether that holds for it, or for a folder that it lies in."""
    whole = path.absolute()
    return any(map(is_planted, (whole, *whole.parents)))
