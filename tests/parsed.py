"""Cache of syntax trees of source files, because several tests read all files."""

import ast
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a Python file, which must not be modified."""
    return ast.parse(path.read_text(encoding="utf-8"))
