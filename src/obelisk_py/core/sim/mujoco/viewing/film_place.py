"""A file that is there whole or not at all, whatever becomes of who writes it.

It has no name until it is finished, so that one who is killed leaves nothing behind; only where the
file system knows no such files it has a hidden name meanwhile. A file that is there is never
replaced.

Source: open(2), O_TMPFILE.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

__all__ = ["UnfinishedFile", "free_name", "unfinished"]


def free_name(path: Path) -> Path:
    """`path`, or where that is taken `name-2.mp4`, `name-3.mp4`, ..."""
    number, name = 1, path
    while name.exists():
        number += 1
        name = path.with_stem(f"{path.stem}-{number}")
    return name


class UnfinishedFile:
    """A file on its way; `finish` gives it its name."""

    def __init__(self, file: IO[bytes], name: Path | None) -> None:
        self.file = file
        """To be written to, and read."""
        self._name = name

    def finish(self, path: Path) -> None:
        """Put the file at `path`.

        Raises:
            OSError: it does not get there; `FileExistsError` where another one is.
        """
        self.file.flush()
        os.link(self._name or f"/proc/self/fd/{self.file.fileno()}", path, follow_symlinks=True)


@contextmanager
def unfinished(folder: Path) -> Iterator[UnfinishedFile]:
    """A file that will be in `folder`; gone at the end unless it was finished.

    Raises:
        OSError: none can be made there.
    """
    try:
        descriptor, name = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666), None
    except (IsADirectoryError, FileNotFoundError, OSError) as error:
        if not _is_unknown(error):
            raise
        descriptor, text = tempfile.mkstemp(dir=folder, prefix=".film-")
        name = Path(text)
    try:
        with os.fdopen(descriptor, "w+b") as file:
            yield UnfinishedFile(file, name)
    finally:
        if name is not None:
            with suppress(FileNotFoundError):
                name.unlink()
