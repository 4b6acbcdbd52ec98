"""Reading a config to edit its text, and putting the edited text back as the bytes it was."""

import codecs
import sys
from dataclasses import dataclass
from pathlib import Path

from obk_cli.config.yaml_parser import decode_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import SourceFile
from obk_cli.errors import CommandFailedError
from obk_cli.files import STANDARD_INPUT, read_bytes, unwritable, write_bytes
from obk_cli.workspace.path_suggestions import did_you_mean_config

__all__ = ["EditedFile", "open_for_edit", "print_bytes", "write_edited"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EditedFile:
    """A file whose text is to change; what is in front of the text stays."""

    source: SourceFile
    data: bytes
    """The file as it was read."""

    def bytes_of(self, text: str) -> bytes:
        """The file with another text: its byte order mark stays."""
        mark = codecs.BOM_UTF8 if self.data.startswith(codecs.BOM_UTF8) else b""
        return mark + text.encode("utf-8")


def open_for_edit(path: str) -> EditedFile | Diagnostic:
    """A config by its path; `-` is the standard input.

    Raises:
        CommandFailedError: it cannot be read.
    """
    data = read_bytes(path)
    if isinstance(data, str):
        raise CommandFailedError(f"`{path}` cannot be read: {data}", help=did_you_mean_config(path))
    shown = "<standard input>" if path == STANDARD_INPUT else path
    source = decode_source(shown, data)
    return source if isinstance(source, Diagnostic) else EditedFile(source=source, data=data)


def write_edited(file: EditedFile, text: str) -> None:
    """Replace the file, unless somebody else has changed it since it was read.

    Raises:
        CommandFailedError: it has changed, or cannot be written.
    """
    path = Path(file.source.path)
    try:
        if path.read_bytes() != file.data:
            raise CommandFailedError(f"`{path}` has changed meanwhile, nothing is written")
        write_bytes(path, file.bytes_of(text))
    except OSError as error:
        raise unwritable(path, error) from error


def print_bytes(data: bytes) -> None:
    """Bytes to the standard output as they are: line ends are the file's own."""
    sys.stdout.flush()
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()
