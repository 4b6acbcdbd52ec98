"""What an edit changes, as a unified diff that `patch` and `git apply` take."""

import difflib
import re

from obk_cli.diagnostics.source import SourceFile

__all__ = ["report_diff"]

_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+$")
_COLOURS = {"+": "32", "-": "31", "@": "36"}


def report_diff(source: SourceFile, text: str, *, colour: bool) -> str:
    """The diff from a source to its new text, empty where they are equal."""
    old, new = _LINE.findall(source.text), _LINE.findall(text)
    lines = difflib.unified_diff(old, new, f"a/{source.path}", f"b/{source.path}")
    return "".join(_shown(line, colour) for line in lines)


def _shown(line: str, colour: bool) -> str:
    if not line.endswith(("\n", "\r")):
        line += "\n\\ No newline at end of file\n"
    role = None if line.startswith(("---", "+++")) else _COLOURS.get(line[0])
    if not colour or role is None:
        return line
    body = line.rstrip("\r\n")
    return f"\x1b[{role}m{body}\x1b[0m{line[len(body) :]}"
