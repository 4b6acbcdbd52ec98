"""A console script added to a package's setup.py, every other character kept.

In: its text. Out: its new text, or why it cannot be done and what the user can do. Never runs it
and never touches the disk.
"""

import ast
from dataclasses import dataclass

from obk_cli.scaffold.names import Problem

__all__ = ["add_entry_point"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scripts:
    """The list under `console_scripts`; the places are indices into the text."""

    values: tuple[str, ...]
    start: int
    """Of the opening bracket."""
    close: int
    """Of the closing bracket."""
    last_end: int
    """Behind the last element, or behind the opening bracket where there is none."""


def add_entry_point(setup_py: str, script: str) -> str | Problem:
    """Add a console script ("foo = pkg.foo:main") to the list of them."""
    scripts = _find_scripts(setup_py)
    if scripts is None:
        return Problem(
            sentence="setup.py holds no plain list of strings under `console_scripts`, so the "
            "entry point cannot be added without touching the rest",
            help=f'make it a list that holds "{script}", or make a package of its own with --dest',
        )
    taken = next((v for v in scripts.values if _executable(v) == _executable(script)), None)
    if taken is None:
        return _insert(setup_py, scripts, script)
    if "".join(taken.split()) == "".join(script.split()):
        return setup_py
    return Problem(
        sentence=f"setup.py has the executable `{_executable(script)}` already: {taken}",
        help="choose another name",
    )


def _executable(script: str) -> str:
    return script.partition("=")[0].strip()


def _insert(text: str, scripts: _Scripts, script: str) -> str:
    newline = "\r\n" if "\r\n" in text else "\n"
    head, quoted = text[: scripts.last_end], f'"{script}"'
    line_start = text.rfind("\n", 0, scripts.close) + 1
    if not scripts.values:
        margin = _indent_at(text, scripts.close)
        filling = f"{newline}{margin}    {quoted},{newline}{margin}"
        return text[: scripts.start + 1] + filling + text[scripts.close :]
    if text[line_start : scripts.close].strip():
        return f"{head}, {quoted}{text[scripts.last_end :]}"
    on_first_line = "\n" not in text[scripts.start : scripts.last_end]
    margin = (
        text[line_start : scripts.close] + "    "
        if on_first_line
        else _indent_at(text, scripts.last_end)
    )
    comma = "" if _has_comma(text[scripts.last_end : scripts.close]) else ","
    between = text[scripts.last_end : line_start]
    return f"{head}{comma}{between}{margin}{quoted},{newline}{text[line_start:]}"


def _find_scripts(setup_py: str) -> _Scripts | None:
    """The one `"console_scripts": [...]` whose elements are all plain strings."""
    try:
        tree = ast.parse(setup_py)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    lists = [
        value
        for node in ast.walk(tree)
        if isinstance(node, ast.Dict)
        for key, value in zip(node.keys, node.values, strict=True)
        if isinstance(key, ast.Constant) and key.value == "console_scripts"
    ]
    if len(lists) != 1 or not isinstance(lists[0], ast.List):
        return None
    elements = lists[0].elts
    values = [e.value for e in elements if isinstance(e, ast.Constant)]
    strings = tuple(value for value in values if isinstance(value, str))
    if len(strings) != len(elements):
        return None
    start = _offset(setup_py, lists[0].lineno, lists[0].col_offset)
    return _Scripts(
        values=strings,
        start=start,
        close=_end_offset(setup_py, lists[0]) - 1,
        last_end=_end_offset(setup_py, elements[-1]) if elements else start + 1,
    )


def _has_comma(text: str) -> bool:
    """Whether a comma stands in code that holds nothing else but comments."""
    return any("," in line.partition("#")[0] for line in text.splitlines())


def _indent_at(text: str, place: int) -> str:
    """The white space at the start of the line that holds a place."""
    line = text[text.rfind("\n", 0, place) + 1 :]
    return line[: len(line) - len(line.lstrip(" \t"))]


def _end_offset(text: str, node: ast.expr) -> int:
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    return _offset(text, node.end_lineno, node.end_col_offset)


def _offset(text: str, line: int, column: int) -> int:
    """A place of the ast, line from 1 and column in UTF-8 bytes, as an index into the text."""
    lines = text.split("\n")
    before = sum(len(other) + 1 for other in lines[: line - 1])
    return before + len(lines[line - 1].encode()[:column].decode())
