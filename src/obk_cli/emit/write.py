"""Writing a file: whole or not at all, and only if it changes."""

import os
import tempfile
from pathlib import Path

__all__ = ["write_bytes", "write_text"]


def write_text(path: Path, text: str, *, mode: int = 0o644) -> bool:
    """Put `text` into the file as UTF-8; see `write_bytes`."""
    return write_bytes(path, text.encode("utf-8"), mode=mode)


def write_bytes(path: Path, data: bytes, *, mode: int = 0o644) -> bool:
    """Put `data` into the file, making its folder; tells whether anything changed.

    A file that is replaced gets `mode`.

    Raises:
        OSError: the folder or the file cannot be written; the old file is as it was.
    """
    if path.is_file() and path.read_bytes() == data:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        temporary.chmod(mode)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return True
