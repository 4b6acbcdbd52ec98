"""What a run would change, as a unified diff.

In: decisions. Out: text that `patch -p1` takes. Never touches the disk.
"""

import difflib
from collections.abc import Iterable
from io import StringIO

from obk_cli.scaffold.decide import Action, Decision

__all__ = ["unified_diff"]

_UNCHANGED = frozenset({Action.IDENTICAL, Action.KEEP})


def unified_diff(decisions: Iterable[Decision]) -> str:
    """The diff of all files that change; a new file is one against `/dev/null`."""
    changed = (decision for decision in decisions if decision.action not in _UNCHANGED)
    return "".join(line for decision in changed for line in _file_diff(decision))


def _file_diff(decision: Decision) -> Iterable[str]:
    path = decision.file.path
    old, new = _lines(decision.before or b""), _lines(decision.file.content)
    if old is None or new is None:
        yield f"Binary files a/{path} and b/{path} differ\n"
        return
    before = "/dev/null" if decision.before is None else f"a/{path}"
    for line in difflib.unified_diff(old, new, before, f"b/{path}"):
        yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _lines(content: bytes) -> list[str] | None:
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return None
    return list(StringIO(text, newline="\n"))  # `splitlines` cuts at form feeds too
