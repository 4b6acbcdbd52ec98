"""Reading files of the user's; the system's errors, of writing too, told in one sentence."""

import sys
from pathlib import Path

from obk_cli.diagnostics.source import LONGEST_FILE_BYTES
from obk_cli.errors import CommandFailedError

__all__ = ["STANDARD_INPUT", "explain_os_error", "read_bytes", "unwritable"]

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
