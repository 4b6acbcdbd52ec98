"""Errors outside the config, such as a missing file or a bad option, and their exit codes.

The command line prints each error as one message.
"""

import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

__all__ = [
    "EXIT_CLOSED_PIPE",
    "EXIT_DONE",
    "EXIT_FAILED",
    "EXIT_INTERRUPTED",
    "EXIT_MISUSE",
    "CommandFailedError",
    "CommandInterruptedError",
    "MisuseError",
    "ObkError",
    "pythonpath_shadow",
    "resource_error",
]

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
EXIT_MISUSE: Final = 2
EXIT_INTERRUPTED: Final = 130
EXIT_CLOSED_PIPE: Final = 141
"""Exit code of a program killed by SIGPIPE: the reader of its output, as `head`, has exited."""


class ObkError(Exception):
    """A command cannot do its work; the message is for the user."""

    exit_code: int = EXIT_FAILED

    def __init__(self, message: str, *, help: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.help = help


class MisuseError(ObkError):
    """The command line is invalid: an option's value or a combination of options."""

    exit_code = EXIT_MISUSE


class CommandInterruptedError(ObkError):
    """Ctrl-C stopped a command; the message says what was left unchanged."""

    exit_code = EXIT_INTERRUPTED


class CommandFailedError(ObkError):
    """A command ran and failed for a reason outside the config."""


_MEMORY: Final = "out of memory (see `ulimit -v`)"
_THREADS: Final = "cannot start more threads or processes (see `ulimit -u`, `ulimit -v`)"
_RESOURCE_ERRORS: Final = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota of this user is exceeded",
    errno.EFBIG: "the file size limit is exceeded (see `ulimit -f`)",
    errno.EROFS: "the file system is read-only",
    errno.EMFILE: "too many open files in this process (see `ulimit -n`)",
    errno.ENFILE: "too many open files in the system",
    errno.ENOMEM: _MEMORY,
    errno.EAGAIN: _THREADS,
}
_SOURCE: Final = Path(__file__).absolute().parents[1]
_NO_THREAD: Final = "can't start new thread"
"""Message of the error that Python raises."""


def resource_error(error: BaseException) -> str | None:
    """Which resource of the machine is exhausted; None: the error has another cause."""
    match error:
        case MemoryError():
            return _MEMORY
        case RuntimeError() if str(error) == _NO_THREAD:
            return _THREADS
        case FileNotFoundError() if not _has_working_folder():
            return "the working folder no longer exists"
        case BlockingIOError() if hasattr(error, "characters_written"):
            return None  # a non-blocking output
        case OSError(errno=int() as number) if number in _RESOURCE_ERRORS:
            return f"{_place(error)}{_RESOURCE_ERRORS[number]}"
    return None


def pythonpath_shadow(error: BaseException) -> str | None:
    """Which file on PYTHONPATH shadows a library and caused the error; None: no such file.

    Other environments add their folders there, which seldom match this Python.
    """
    listed = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    folders = [Path(folder).absolute() for folder in listed if folder]
    for name in _files_of(error):
        file = Path(name).absolute()
        if any(file.is_relative_to(folder) for folder in folders) and _SOURCE not in file.parents:
            return f"`{file}` shadows a library because its folder is on PYTHONPATH"
    return None


def _files_of(error: BaseException) -> Iterator[str]:
    """Files that may have caused an error: of the named module, and of the line that failed."""
    top = (error.name or "").partition(".")[0] if isinstance(error, ImportError) else ""
    modules = (getattr(error, "obj", None), sys.modules.get(top))
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    files = (
        *(getattr(module, "__file__", None) for module in modules),
        *(getattr(error, name, None) for name in ("path", "filename")),
        trace.tb_frame.f_code.co_filename if trace else None,
    )
    yield from (file for file in files if isinstance(file, str))


def _place(error: OSError) -> str:
    name = error.filename
    return f"`{os.fsdecode(name)}`: " if isinstance(name, str | bytes) else ""


def _has_working_folder() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True
