"""Read user files, write files whole or not at all, and recognize files that other users own."""

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from obk_cli.diagnostics.source import LONGEST_FILE_BYTES
from obk_cli.errors import CommandFailedError

__all__ = [
    "SHARED_FOLDER_BITS",
    "STANDARD_INPUT",
    "STATE_MODE",
    "explain_os_error",
    "is_untrusted",
    "is_within_untrusted",
    "path_exists",
    "read_bytes",
    "resource_folder",
    "unwritable",
    "whole_file",
    "write_bytes",
    "write_text",
]

STANDARD_INPUT = "-"
_MOST_BYTES = LONGEST_FILE_BYTES + 1


def read_bytes(path: str) -> bytes | str:
    """The content of a file, or why it cannot be read; `-` is the standard input.

    A file longer than any config is cut one byte past the limit.
    """
    try:
        if path == STANDARD_INPUT:
            # None if the parent process closed it.
            return sys.stdin.buffer.read(_MOST_BYTES) if sys.stdin else "the stream is closed"
        if _is_named_pipe(Path(path)):
            return "it is a named pipe"
        with Path(path).open("rb") as file:
            return file.read(_MOST_BYTES)
    except (OSError, ValueError) as error:
        return explain_os_error(error)


def _is_named_pipe(path: Path) -> bool:
    """Whether opening it would wait for a writer; a shell's pipe already has one."""
    return path.is_fifo() and not path.resolve().is_relative_to("/proc")


def explain_os_error(error: OSError | ValueError) -> str:
    """A short reason for a system error."""
    match error:
        case FileNotFoundError():
            return "file not found"
        case IsADirectoryError():
            return "it is a directory"
        case PermissionError():
            return "permission denied"
        case OSError(strerror=str() as text):
            return text.lower()
    return str(error)


def unwritable(path: Path, error: OSError) -> CommandFailedError:
    """The error for a command that cannot write its file."""
    reason = explain_os_error(error)
    if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
        reason = f"the folder {path.parent} does not exist"
    elif isinstance(error, PermissionError):
        reason = "permission denied"
    return CommandFailedError(f"`{path}` cannot be written: {reason}")


SHARED_FOLDER_BITS: Final = stat.S_ISVTX | stat.S_IWOTH
"""Mode of a folder such as /tmp: any user may add files, only their owner may remove them."""


def is_untrusted(path: Path) -> bool:
    """Whether another user put the file into a folder that all users share, such as /tmp.

    It could otherwise change what this user runs from the same folder.
    """
    try:
        owner, mode = path.lstat().st_uid, path.parent.stat().st_mode
    except OSError:
        return False
    return owner not in (os.geteuid(), 0) and mode & SHARED_FOLDER_BITS == SHARED_FOLDER_BITS


def is_within_untrusted(path: Path) -> bool:
    """Whether the path or a folder above it is untrusted."""
    whole = path.absolute()
    return any(map(is_untrusted, (whole, *whole.parents)))


def path_exists(path: str | Path) -> bool:
    """Whether a path exists; `Path.exists` raises an error if the name is too long."""
    return os.path.exists(path)  # noqa: PTH110


STATE_MODE = 0o600
"""Mode of state files, such as a run's arguments and status; only their owner may read them."""
_NEW_MODE = 0o666
"""Mode of other new files, before the user's umask."""


def write_text(path: Path, text: str, *, mode: int | None = None) -> bool:
    """Write text as UTF-8; escaped bytes, as in file names, are restored."""
    return write_bytes(path, text.encode("utf-8", "surrogateescape"), mode=mode)


def write_bytes(path: Path, data: bytes, *, mode: int | None = None) -> bool:
    """Write a file whole or not at all, with its folder; return whether anything changed.

    Links are followed. Pipes and devices are written to, not replaced.

    Args:
        path: the file.
        data: its complete content.
        mode: its permissions; None: keep owner and permissions of the replaced file, otherwise
            those of any new file.

    Raises:
        OSError: the folder or the file cannot be written; the old file is unchanged.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        path.write_bytes(data)
        return True
    if path.is_file() and path.read_bytes() == data:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.urandom(4).hex()}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    handle = os.open(temporary, flags, _NEW_MODE if mode is None else mode)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            if mode is None and target.is_file():
                file.flush()
                os.fsync(file.fileno())
                _copy_owner_and_mode(target, temporary)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return True


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Write a file in parts, whole or not at all, with its folder.

    Yields:
        A path in the same folder, where nothing exists; the file there replaces `path` at the end.

    Raises:
        CommandFailedError: the folder or the file cannot be written; the old file is unchanged.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name}.{os.urandom(4).hex()}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(path, error) from error


def _copy_owner_and_mode(old: Path, new: Path) -> None:
    """Copy owner and permissions of the replaced file to the new one."""
    before = old.stat()
    with suppress(PermissionError):  # only root can change owners, and only root needs to
        os.chown(new, before.st_uid, before.st_gid)
    new.chmod(stat.S_IMODE(before.st_mode))


def resource_folder(name: str) -> Path:
    """The folder of resources ("schema", "templates") that is installed with this code.

    Raises:
        FileNotFoundError: the folder is in neither location; the installation is broken.
    """
    package = Path(__file__).resolve().parent
    places = (package / "data" / name, package.parents[1] / name)
    found = next((place for place in places if place.is_dir()), None)
    if found is None:
        tried = ", ".join(str(place) for place in places)
        raise FileNotFoundError(
            f"the folder `{name}` of the obk installation is missing; tried {tried}"
        )
    return found
