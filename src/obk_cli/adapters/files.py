"""Reading files of the user's, the system's errors told in one sentence."""

import sys
from pathlib import Path

__all__ = ["STANDARD_INPUT", "explain_os_error", "read_bytes"]

STANDARD_INPUT = "-"


def read_bytes(path: str) -> bytes | str:
    """What a file holds, or why it cannot be read; `-` is the standard input."""
    if path == STANDARD_INPUT:
        return sys.stdin.buffer.read()
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        return explain_os_error(error)


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
