"""Files that a command edits: read once, replaced as a whole, shown as a diff."""

import codecs
import difflib
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from obk_cli.config.yaml_parser import decode_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.files import STANDARD_INPUT, read_bytes, unwritable, write_bytes
from obk_cli.workspace.config_files import did_you_mean_config

__all__ = ["EditedFile", "open_for_edit", "print_bytes", "report_diff", "write_edited"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EditedFile:
    """A file to edit; its byte order mark is kept."""

    source: SourceFile
    data: bytes
    """The file as it was read."""

    def bytes_of(self, text: str) -> bytes:
        """The file's bytes with a new text; the byte order mark is kept."""
        mark = codecs.BOM_UTF8 if self.data.startswith(codecs.BOM_UTF8) else b""
        return mark + text.encode("utf-8")


def open_for_edit(path: str) -> EditedFile | Diagnostic:
    """Open a config by its path; `-` is standard input.

    Raises:
        CommandFailedError: the file cannot be read.
    """
    data = read_bytes(path)
    if isinstance(data, str):
        raise CommandFailedError(f"`{path}` cannot be read: {data}", help=did_you_mean_config(path))
    shown = "<standard input>" if path == STANDARD_INPUT else path
    source = decode_source(shown, data)
    return source if isinstance(source, Diagnostic) else EditedFile(source=source, data=data)


def write_edited(file: EditedFile, text: str) -> None:
    """Replace the file, unless it has changed since it was read.

    Raises:
        CommandFailedError: the file has changed or cannot be written.
    """
    path = Path(file.source.path)
    try:
        if path.read_bytes() != file.data:
            raise CommandFailedError(f"`{path}` changed during the edit; nothing was written")
        write_bytes(path, file.bytes_of(text))
    except OSError as error:
        raise unwritable(path, error) from error


def print_bytes(data: bytes) -> None:
    """Write bytes to standard output unchanged, with the file's own line ends."""
    sys.stdout.flush()
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+$")
_COLOURS = {"+": "32", "-": "31", "@": "36"}


def report_diff(source: SourceFile, text: str, *, colour: bool) -> str:
    """The diff from a source to its new text; empty if they are equal."""
    old, new = _LINE.findall(source.text), _LINE.findall(text)
    path = source.path.lstrip("/")
    lines = difflib.unified_diff(old, new, f"a/{path}", f"b/{path}")
    return "".join(_shown(line, colour) for line in lines)


def _shown(line: str, colour: bool) -> str:
    if not line.endswith(("\n", "\r")):
        line += "\n\\ No newline at end of file\n"
    role = None if line.startswith(("---", "+++")) else _COLOURS.get(line[0])
    if not colour or role is None:
        return line
    body = line.rstrip("\r\n")
    return f"\x1b[{role}m{body}\x1b[0m{line[len(body) :]}"
