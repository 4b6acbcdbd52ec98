"""Find out which files the code of tests and nodes reads, to notice when one of them changes."""

import os
import sys
from collections.abc import Collection
from contextlib import suppress
from importlib.util import source_from_cache
from pathlib import Path
from types import FrameType
from typing import Any, Final

__all__ = ["FilesRead"]

_TOOLS: Final = ("obk_cli.", "obk_testing.", "_pytest.", "pluggy.")
"""Modules that read files on their own behalf."""
_LEFT_OUT: Final = frozenset({"__pycache__", "build", ".git", ".venv", "site-packages"})


class FilesRead:
    """The files in some folders that user code has opened in this process, but never to write."""

    def __init__(self, folders: Collection[Path]) -> None:
        """Start recording; it cannot be stopped, because Python never removes an audit hook.

        Args:
            folders: absolute paths; also the files in their subfolders are recorded.
        """
        self._folders = tuple(f"{folder}{os.sep}" for folder in folders)
        self._read: dict[str, None] = {}
        self._written: set[str] = set()
        self._taken: set[str] = set()
        sys.addaudithook(self._audit)

    def take(self) -> tuple[str, ...]:
        """Return the absolute paths of the files that no earlier call has returned."""
        known = self._written | self._taken
        # A copy, because other threads may open files.
        new = [path for path in tuple(self._read) if path not in known]
        self._taken.update(new)
        return tuple(new)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        name, mode, flags = arguments
        path = os.path.abspath(os.fsdecode(name))  # noqa: PTH100 - symbolic links stay
        if path.endswith(".pyc"):
            with suppress(ValueError):
                path = source_from_cache(path)
        if not self._is_own(path):
            return
        if flags & os.O_ACCMODE != os.O_RDONLY or not {"w", "a", "x", "+"}.isdisjoint(mode or ""):
            self._written.add(path)
        elif self._is_of_user(sys._getframe(1)):
            self._read[path] = None

    def _is_own(self, path: str) -> bool:
        return path.startswith(self._folders) and _LEFT_OUT.isdisjoint(Path(path).parts)

    def _is_of_user(self, frame: FrameType | None) -> bool:
        """Whether a test or a node has called the function, perhaps through a library."""
        while frame is not None:
            if f"{frame.f_globals.get('__name__', '')}.".startswith(_TOOLS):
                return False
            if self._is_own(frame.f_code.co_filename):
                return True
            frame = frame.f_back
        return False
