"""Decide what happens to each file, then write all of them or none.

A new package appears in one rename; in an existing one, all changes are undone if one fails.
Symbolic links are not followed out of the folder.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path, PurePosixPath

from obk_cli.scaffold.templates import RenderedFile

__all__ = [
    "Action",
    "Decision",
    "Existing",
    "conflicts",
    "decide",
    "read_existing",
    "write_decisions",
]


class Action(StrEnum):
    """What happens to a file."""

    CREATE = "create"
    IDENTICAL = "identical"
    EDIT = "edit"
    REPLACE = "replace"
    KEEP = "keep"
    CONFLICT = "conflict"


@dataclass(frozen=True, slots=True, kw_only=True)
class Existing:
    """The existing content at a file's path.

    `content` is None if it is not a regular file inside the package: for example a folder, or a
    path that a symbolic link redirects. `reason` says which; such a path is never written.
    """

    content: bytes | None
    reason: str = "it has different content"


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A file and what happens to it; `reason` is set for a conflict."""

    file: RenderedFile
    action: Action
    reason: str = ""
    before: bytes | None = None
    """The current content of the file; None if it does not exist."""


def decide(
    files: Iterable[RenderedFile],
    existing: Mapping[PurePosixPath, Existing],
    *,
    edits: Iterable[RenderedFile] = (),
    force: bool = False,
) -> tuple[Decision, ...]:
    """One decision per file, in the given order; `edits` are new versions of existing files."""
    return (
        *(_decide_new(file, existing.get(file.path), force=force) for file in files),
        *(_decide_edit(file, existing.get(file.path)) for file in edits),
    )


def conflicts(decisions: Iterable[Decision]) -> tuple[Decision, ...]:
    """The decisions that prevent writing."""
    return tuple(decision for decision in decisions if decision.action is Action.CONFLICT)


def _decide_new(file: RenderedFile, there: Existing | None, *, force: bool) -> Decision:
    if there is None:
        return Decision(file=file, action=Action.CREATE)
    before = there.content
    if before == file.content:
        return Decision(file=file, action=Action.IDENTICAL, before=before)
    if force and before is not None:
        return Decision(file=file, action=Action.REPLACE, before=before)
    return Decision(file=file, action=Action.CONFLICT, reason=there.reason, before=before)


def _decide_edit(file: RenderedFile, there: Existing | None) -> Decision:
    if there is None or there.content is None:
        reason = there.reason if there else "it no longer exists"
        return Decision(file=file, action=Action.CONFLICT, reason=reason)
    same = there.content == file.content
    action = Action.IDENTICAL if same else Action.EDIT
    return Decision(file=file, action=action, before=there.content)


_WRITTEN = frozenset({Action.CREATE, Action.REPLACE, Action.EDIT})


def read_existing(root: Path, paths: Iterable[PurePosixPath]) -> dict[PurePosixPath, Existing]:
    """The existing content at each path below `root`; omits paths where nothing exists.

    Raises:
        OSError: a file exists but cannot be read.
    """
    found = ((path, _read_place(root, path)) for path in paths)
    return {path: there for path, there in found if there is not None}


def write_decisions(
    root: Path, decisions: Iterable[Decision], *, finish: Callable[[], None] = lambda: None
) -> None:
    """Carry out the decisions below `root`, which need not exist yet, then call `finish`.

    Everything is written to a hidden folder first: beside a new `root`, otherwise inside it, so
    that it is on the same disk. `finish` runs when all files are in place. If anything fails later,
    even `finish`, or is interrupted, the old state is restored.

    Raises:
        OSError: the folder cannot be written, or a file has changed since it was read.
    """
    written = [decision for decision in decisions if decision.action in _WRITTEN]
    with ExitStack() as undo_folders:
        _make_folders(root.parent, undo_folders)
        beside = root if root.exists() else root.parent
        with (
            tempfile.TemporaryDirectory(prefix=f".{root.name}.", dir=beside) as stage,
            ExitStack() as undo,
        ):
            fresh = Path(stage, "new")
            _write_files(fresh, [decision.file for decision in written])
            if root.exists():
                _merge(fresh, root, written, Path(stage, "old"), undo)
            else:
                fresh.rename(root)
                undo.callback(root.rename, fresh)
            finish()
            undo.pop_all()
        undo_folders.pop_all()


def _read_place(root: Path, path: PurePosixPath) -> Existing | None:
    target = root / path
    if not target.resolve().is_relative_to(root.resolve()):
        return Existing(content=None, reason=f"a symbolic link redirects it to {target.resolve()}")
    if target.is_file():
        return Existing(content=target.read_bytes())
    if target.exists() or target.is_symlink():
        return Existing(content=None, reason="it exists and is not a file")
    blocked = next((p for p in target.relative_to(root).parents if (root / p).is_file()), None)
    if blocked is None:
        return None
    return Existing(content=None, reason=f"`{blocked}` is a file, not a folder")


def _write_files(folder: Path, files: Iterable[RenderedFile]) -> None:
    folder.mkdir()
    for file in files:
        target = folder / file.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.content)
        # A script can be run by all users who can read it.
        mode = target.stat().st_mode
        target.chmod(mode | (mode >> 2 & file.mode & 0o111))


def _merge(
    fresh: Path, root: Path, decisions: Iterable[Decision], backup: Path, undo: ExitStack
) -> None:
    """Move files into an existing folder; each step's undo is registered before the step."""
    for decision in decisions:
        path = decision.file.path
        target, saved = root / path, backup / path
        now = target.read_bytes() if target.exists() else None
        if now != decision.before:
            raise OSError(f"{target} has changed in the meantime")
        if now is not None:
            saved.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(target, saved)
            shutil.copymode(target, fresh / path)
            undo.callback(saved.replace, target)
        else:
            _make_folders(target.parent, undo)
            undo.callback(target.unlink, missing_ok=True)
        (fresh / path).replace(target)


def _make_folders(folder: Path, undo: ExitStack) -> None:
    """Create a folder and its missing parents; undoing removes those that were created."""
    if folder.is_dir():
        return
    _make_folders(folder.parent, undo)
    undo.callback(_remove_if_empty, folder)
    folder.mkdir()


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()
