"""Which findings the user wants to hear: `--ignore`, `obk: {ignore: [...]}`, comments on a line.

An error despite which no plan could be made is always heard.
"""

import re
from collections.abc import Iterable

from obk_cli.diagnostics import Diagnostic

__all__ = ["silence"]

_COMMENT = re.compile(r"#\s*obk:\s*ignore\[([^\]]*)\]")
_MAY_BE_SILENCED = ("OBK101", "OBK107", "OBK108", "OBK115", "OBK2", "OBK3", "OBK4", "OBK5")


def silence(diagnostics: Iterable[Diagnostic], codes: Iterable[str]) -> tuple[Diagnostic, ...]:
    """The findings that remain; a code silences every code that begins with it (`OBK4`)."""
    prefixes = tuple(codes)
    return tuple(
        diagnostic
        for diagnostic in diagnostics
        if not diagnostic.code.startswith((*prefixes, *_on_line(diagnostic)))
        or (diagnostic.severity == "error" and not diagnostic.code.startswith(_MAY_BE_SILENCED))
    )


def _on_line(diagnostic: Diagnostic) -> tuple[str, ...]:
    comment = _COMMENT.search(diagnostic.span.source.line(diagnostic.span.line))
    if comment is None:
        return ()
    return tuple(code for part in comment[1].split(",") if (code := part.strip()))
