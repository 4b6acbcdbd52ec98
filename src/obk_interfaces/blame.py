"""Finds the line that the translator of message definitions stumbles over.

In goes a definition that it refused; out comes the place with its own words. The translator names
the file at best, but takes a line alone as well.
"""

import contextlib
import importlib
import io
import re
from pathlib import Path

from obk_interfaces.errors import Problem

__all__ = ["find_refused_line"]

_BEFORE_VALUE = re.compile(r"\s*\S+\s+[^\s=]+\s*=?\s*")


def find_refused_line(path: Path, package: str) -> Problem | None:
    """The first line that is refused by itself, None where it takes several to be wrong."""
    parse = importlib.import_module("rosidl_adapter.parser").parse_message_string
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip() == "---":
            continue
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                parse(package, "Message", line.strip())
        except Exception as error:  # of whatever kind
            before = _BEFORE_VALUE.match(line)
            column = before.end() + 1 if before and before.end() < len(line) else 1
            return Problem(path=path, line=number, column=column, sentence=str(error))
    return None
