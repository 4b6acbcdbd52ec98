"""Which findings the user wants to hear: `--ignore`, `obk: {ignore: [...]}`, comments on a line.

An error despite which no plan could be made is always heard.
"""

import re
from collections.abc import Collection, Iterable

from obk_cli.diagnostics import Diagnostic

__all__ = ["silence"]

_COMMENT = re.compile(r"#\s*obk:\s*ignore\[([^\]]*)\]")
_MAY_BE_SILENCED = ("OBK101", "OBK107", "OBK108", "OBK115", "OBK2", "OBK3", "OBK4", "OBK5")


def silence(diagnostics: Collection[Diagnostic], codes: Iterable[str]) -> tuple[Diagnostic, ...]:
    """The findings that remain; a code silences every code that begins with it (`OBK4`)."""
    prefixes = tuple(codes)
    on_line: dict[tuple[str, int], tuple[str, ...]] = {}
    for diagnostic in diagnostics:
        place = (diagnostic.span.path, diagnostic.span.line)
        if place not in on_line:  # a line may be long, and have many findings
            on_line[place] = _on_line(diagnostic)
    return tuple(
        diagnostic
        for diagnostic in diagnostics
        if not diagnostic.code.startswith(
            (*prefixes, *on_line[diagnostic.span.path, diagnostic.span.line])
        )
        or (diagnostic.severity == "error" and not diagnostic.code.startswith(_MAY_BE_SILENCED))
    )


def _on_line(diagnostic: Diagnostic) -> tuple[str, ...]:
    comment = _COMMENT.search(diagnostic.span.source.line(diagnostic.span.line))
    if comment is None:
        return ()
    return tuple(code for part in comment[1].split(",") if (code := part.strip()))
