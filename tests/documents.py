"""The documentation pages and their example blocks, as steps that a test can perform.

`sh` blocks are commands. A `text` block is part of the output of the preceding commands, in this
order and with anything in between (`...` in a line matches anything). A `diff` block is edits of
one file: lines that occur exactly once, and their replacements; `@@` separates two edits. A block
after "`path`:" is a new file.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PAGES: Final = tuple(
    sorted(
        page
        for pattern in ("*.md", "docs/**/*.md", "examples/*/README.md", "benchmarks/*.md")
        for page in ROOT.glob(pattern)
        if page.parent != ROOT / "docs/reference/rules"
    )
)
"""Every page, including new ones; the pages of rules are generated from tests/cases."""
BLOCK: Final = re.compile(
    r"(?:`(?P<path>[^`\s]+\.\w+)`:\n\n|^)```(?P<kind>\w*)\n(?P<body>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
COMMENT: Final = re.compile(r"\s+# .*$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """Commands to type, and the expected output."""

    lines: tuple[str, ...]
    shown: tuple[str, ...]

    @property
    def finds_errors(self) -> bool:
        """Whether the last command is expected to fail, with findings."""
        return any("error[" in line for line in self.shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """Lines of a file to replace."""

    path: str
    old: str
    new: str


@dataclass(frozen=True, slots=True, kw_only=True)
class NewFile:
    """A file that the user of a page writes."""

    path: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """An example block of a page."""

    page: Path
    line: int
    kind: str
    body: str
    path: str | None

    @property
    def name(self) -> str:
        """The location of the block."""
        return f"{page_name(self.page)}:{self.line}"


def page_name(page: Path) -> str:
    """A page's path in the repository."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[Block]:
    """All example blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page=page,
            line=text.count("\n", 0, found.start("body")),
            kind=found["kind"],
            body=found["body"],
            path=found["path"],
        )
        for found in BLOCK.finditer(text)
    ]


def steps(document: Path) -> list[Commands | Edit | NewFile]:
    """The steps of the page, in order."""
    found = blocks(document)
    done: list[Commands | Edit | NewFile] = []
    for place, block in enumerate(found):
        kind, body = block.kind, block.body
        if block.path is not None:
            done.append(NewFile(path=block.path, text=body))
        elif kind == "sh":
            body = body.replace("\\\n", " ")
            following = found[place + 1] if place + 1 < len(found) else None
            shown = following.body.splitlines() if following and _is_output(following) else ()
            lines = (COMMENT.sub("", line) for line in body.splitlines() if line.strip())
            done.append(Commands(lines=tuple(lines), shown=tuple(shown)))
        elif kind == "diff":
            done += _edits(body)
    return done


def _is_output(block: Block) -> bool:
    """A block that starts with a prompt contains its own command."""
    return block.kind == "text" and not block.body.startswith("$ ")


def apply(edit: Edit | NewFile, folder: Path) -> None:
    """Write or change the file; the text to change must occur exactly once."""
    path = folder / edit.path
    if isinstance(edit, NewFile):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(edit.text)
        return
    text = path.read_text()
    assert text.count(edit.old) == 1, f"{edit.path} has not once:\n{edit.old}\nbut is:\n{text}"
    path.write_text(text.replace(edit.old, edit.new))


def missing_lines(shown: tuple[str, ...], seen: str) -> list[str]:
    """The lines of a page that the terminal did not show, or not in this order."""
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
