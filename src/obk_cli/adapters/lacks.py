"""What a machine may lack in the middle of anything: room, memory, files, threads.

Takes an error that nobody expected, gives a sentence for the user, or None where it is another one.
"""

import errno
import os
from pathlib import Path
from typing import Final

__all__ = ["lack_of"]

_MEMORY: Final = "there is not enough memory (see `ulimit -v`)"
_THREADS: Final = "no more threads or processes can be started (see `ulimit -u`, `ulimit -v`)"
_LACKS: Final = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "this user may use no more of the disk",
    errno.EFBIG: "files may not become so long (see `ulimit -f`)",
    errno.EROFS: "the disk can only be read",
    errno.EMFILE: "this process may open no more files (see `ulimit -n`)",
    errno.ENFILE: "the system can open no more files",
    errno.ENOMEM: _MEMORY,
    errno.EAGAIN: _THREADS,
}
_NO_THREAD: Final = "can't start new thread"
"""Python's own words."""


def lack_of(error: BaseException) -> str | None:
    """What of the machine an error is the lack of; None: it is another error."""
    match error:
        case MemoryError():
            return _MEMORY
        case RuntimeError() if str(error) == _NO_THREAD:
            return _THREADS
        case FileNotFoundError() if not _has_working_folder():
            return "the folder that this was started in is not there any more"
        case BlockingIOError() if hasattr(error, "characters_written"):
            return None  # an output that does not wait
        case OSError(errno=int() as number) if number in _LACKS:
            return f"{_place(error)}{_LACKS[number]}"
    return None


def _place(error: OSError) -> str:
    name = error.filename
    return f"`{os.fsdecode(name)}`: " if isinstance(name, str | bytes) else ""


def _has_working_folder() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True
