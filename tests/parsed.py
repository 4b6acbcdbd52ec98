"""Syntax trees of source files, each parsed once in a process: several tests read all files."""

import ast
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a Python file; not to be changed."""
    return ast.parse(path.read_text(encoding="utf-8"))
