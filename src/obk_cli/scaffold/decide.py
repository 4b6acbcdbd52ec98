"""What happens to each file: made, left alone, replaced, edited, or refused.

In: the files that were rendered and what stands there now. Out: one decision for each.
Never looks at the disk and never changes it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import PurePosixPath

from obk_cli.scaffold.render import RenderedFile

__all__ = ["Action", "Decision", "Existing", "conflicts", "decide"]


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
    """What stands where a file is to go.

    `content` is None where it is no ordinary file inside the package: a folder, or a path that
    a symbolic link leads elsewhere. `reason` says which; such a place is never written.
    """

    content: bytes | None
    reason: str = "it is there with other content"


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """A file and what happens to it; `reason` is set for a conflict."""

    file: RenderedFile
    action: Action
    reason: str = ""
    before: bytes | None = None
    """What the file holds now, where there is one."""


def decide(
    files: Iterable[RenderedFile],
    existing: Mapping[PurePosixPath, Existing],
    *,
    edits: Iterable[RenderedFile] = (),
    force: bool = False,
) -> tuple[Decision, ...]:
    """One decision a file, in the order given; `edits` are new versions of existing files."""
    return (
        *(_decide_new(file, existing.get(file.path), force=force) for file in files),
        *(_decide_edit(file, existing.get(file.path)) for file in edits),
    )


def conflicts(decisions: Iterable[Decision]) -> tuple[Decision, ...]:
    """The decisions that stop the whole."""
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
        reason = there.reason if there else "it is gone"
        return Decision(file=file, action=Action.CONFLICT, reason=reason)
    same = there.content == file.content
    action = Action.IDENTICAL if same else Action.EDIT
    return Decision(file=file, action=action, before=there.content)
