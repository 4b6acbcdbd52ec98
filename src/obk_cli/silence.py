"""Which findings the user wants to hear: `--ignore`, `obk: {ignore: [...]}`, comments on a line."""

import re
from collections.abc import Iterable

from obk_cli.diagnostics import Diagnostic

__all__ = ["silence"]

_COMMENT = re.compile(r"#\s*obk:\s*ignore\[([^\]]*)\]")


def silence(diagnostics: Iterable[Diagnostic], codes: Iterable[str]) -> tuple[Diagnostic, ...]:
    """The findings that remain; a code silences every code that begins with it (`OBK4`)."""
    prefixes = tuple(codes)
    return tuple(d for d in diagnostics if not d.code.startswith((*prefixes, *_on_line(d))))


def _on_line(diagnostic: Diagnostic) -> tuple[str, ...]:
    comment = _COMMENT.search(diagnostic.span.source.line(diagnostic.span.line))
    if comment is None:
        return ()
    return tuple(code for part in comment[1].split(",") if (code := part.strip()))
