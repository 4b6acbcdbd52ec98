"""A file that is there whole or not at all, whatever becomes of who writes it.

It has no name until it is finished, so that one who is killed leaves nothing behind; only where the
file system knows no such files it has a hidden name meanwhile. A file that is there is never
replaced.

Source: open(2), O_TMPFILE.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Final

__all__ = ["UnfinishedFile", "free_name", "unfinished"]

_UNKNOWN: Final = (errno.EOPNOTSUPP, errno.EISDIR)
"""What file systems say that have no files without a name."""


def free_name(path: Path) -> Path:
    """`path`, or where that is taken `name-2.mp4`, `name-3.mp4`, ..."""
    number, name = 1, path
    while os.path.lexists(name):
        number += 1
        name = path.with_stem(f"{path.stem}-{number}")
    return name


class UnfinishedFile:
    """A file on its way; `finish` gives it its name."""

    def __init__(self, file: IO[bytes], name: Path | None) -> None:
        self.file = file
        """To be written to."""
        self._name = name

    def finish(self, path: Path) -> Path:
        """Put the file at `path`, or beside a file that is there.

        Returns:
            Where it is.

        Raises:
            OSError: it does not get there.
        """
        self.file.flush()
        while True:
            free = free_name(path)
            with suppress(FileExistsError):  # made in this moment
                self._link(free)
                return free

    def _link(self, path: Path) -> None:
        if self._name is not None:
            self._name.rename(path)
            return
        file_fd = self.file.fileno()
        # Only with a descriptor beside it does Python follow the link that /proc has.
        os.link(f"/proc/self/fd/{file_fd}", path, src_dir_fd=file_fd)


@contextmanager
def unfinished(folder: Path) -> Iterator[UnfinishedFile]:
    """A file that will be in `folder`; gone at the end unless it was finished.

    Raises:
        OSError: none can be made there.
    """
    name = None
    try:
        file_fd = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno not in _UNKNOWN:
            raise
        name = folder / f".film-{os.getpid()}"
        file_fd = os.open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(file_fd, "w+b") as file:
            yield UnfinishedFile(file, name)
    finally:
        if name is not None:
            name.unlink(missing_ok=True)
