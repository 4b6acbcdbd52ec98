"""A document that walks through commands, outputs and edits, read as steps that can be done.

`sh` blocks are commands; a `text` block is what the last block of commands shows, in this order and
with anything between (`...` in a line is anything, too); a `diff` block is edits of one file: the
lines that are to be found there, once, and what they become; `@@` stands between two edits.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

BLOCK: Final = re.compile(
    r"^```(?P<kind>sh|text|diff)\n(?P<body>.*?)^```$", re.DOTALL | re.MULTILINE
)
COMMENT: Final = re.compile(r"\s+# .*$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """Lines to type, and what the terminal is to show."""

    lines: tuple[str, ...]
    shown: tuple[str, ...]

    @property
    def finds_errors(self) -> bool:
        """Whether the last of them is to fail, with findings."""
        return any("error[" in line for line in self.shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """Lines of a file that become others."""

    path: str
    old: str
    new: str


def steps(document: Path) -> list[Commands | Edit]:
    """What the document has one do, in its order."""
    blocks = [(found["kind"], found["body"]) for found in BLOCK.finditer(document.read_text())]
    done: list[Commands | Edit] = []
    for place, (kind, body) in enumerate(blocks):
        if kind == "sh":
            following = blocks[place + 1] if place + 1 < len(blocks) else ("", "")
            shown = following[1].splitlines() if following[0] == "text" else ()
            lines = (COMMENT.sub("", line) for line in body.splitlines() if line.strip())
            done.append(Commands(lines=tuple(lines), shown=tuple(shown)))
        elif kind == "diff":
            done += _edits(body)
    return done


def apply(edit: Edit, folder: Path) -> None:
    """Change the file; it has to hold what is to be changed exactly once."""
    path = folder / edit.path
    text = path.read_text()
    assert text.count(edit.old) == 1, f"{edit.path} has not once:\n{edit.old}\nbut is:\n{text}"
    path.write_text(text.replace(edit.old, edit.new))


def missing_lines(shown: tuple[str, ...], seen: str) -> list[str]:
    """The lines of a document that the terminal did not show, or not in their order."""
    missing = []
    rest = seen
    for line in shown:
        words = (re.escape(part) for part in line.rstrip().split("..."))
        found = re.search(rf"^{'.*'.join(words)}", rest, re.MULTILINE)
        if found is None:
            missing.append(line)
        else:
            rest = rest[found.end() :]
    return missing


def _edits(body: str) -> Iterator[Edit]:
    head, *lines = body.splitlines()
    assert head.startswith("--- "), head
    for is_between, hunk in groupby(lines, lambda line: line == "@@"):
        if not is_between:
            part = [*hunk]
            old = "".join(f"{line[1:]}\n" for line in part if line[0] in " -")
            new = "".join(f"{line[1:]}\n" for line in part if line[0] in " +")
            yield Edit(path=head.removeprefix("--- "), old=old, new=new)
