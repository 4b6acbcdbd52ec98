"""Write a file whole or not at all, and only if its content changes."""

import os
import stat
from contextlib import suppress
from pathlib import Path
from secrets import token_hex

__all__ = ["STATE_MODE", "write_bytes", "write_text"]

STATE_MODE = 0o600
"""Of files that are nobody's but their owner's: what a run was given and how it is."""
_NEW_MODE = 0o666
"""Of any new file, less what the user's mask takes away."""


def write_text(path: Path, text: str, *, mode: int | None = None) -> bool:
    """Put `text` into the file as UTF-8, bytes of names that are none as they were."""
    return write_bytes(path, text.encode("utf-8", "surrogateescape"), mode=mode)


def write_bytes(path: Path, data: bytes, *, mode: int | None = None) -> bool:
    """Put `data` into the file, making its folder; tells whether anything changed.

    A link is followed. What is there and is no file, a pipe or a device, takes the data and stays.

    Args:
        path: the file.
        data: all that it is to hold.
        mode: its permissions; None: those of the file that is replaced, and its owner, else those
            of any new one.

    Raises:
        OSError: the folder or the file cannot be written; the old file is as it was.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        path.write_bytes(data)
        return True
    if path.is_file() and path.read_bytes() == data:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{token_hex(4)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    handle = os.open(temporary, flags, _NEW_MODE if mode is None else mode)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            if mode is None and target.is_file():
                file.flush()
                os.fsync(file.fileno())
                _take_after(target, temporary)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return True


def _take_after(old: Path, new: Path) -> None:
    """Give a file the owner and the permissions of the one that it replaces."""
    before = old.stat()
    with suppress(PermissionError):  # only root gives files away, and has to
        os.chown(new, before.st_uid, before.st_gid)
    new.chmod(stat.S_IMODE(before.st_mode))
