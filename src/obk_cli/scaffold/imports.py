"""Import lines in the order that isort and ruff want, however long the names are.

In: the classes that a generated module uses. Out: text. Never imports them.
"""

import re
from collections.abc import Iterable

from obk_cli.scaffold.questions import MessageType

__all__ = ["LINE_LENGTH", "import_block", "import_line", "message_imports"]

LINE_LENGTH = 100
"""Longest line of generated code [characters]."""


def message_imports(messages: Iterable[MessageType]) -> tuple[tuple[str, str], ...]:
    """The (module, class) pairs of message types."""
    return tuple((message.module, message.name) for message in messages)


def import_block(names: Iterable[tuple[str, str]]) -> str:
    """Sorted `from module import a, b` lines for (module, name) pairs; doubles are dropped."""
    by_module: dict[str, set[str]] = {}
    for module, name in names:
        by_module.setdefault(module, set()).add(name)
    return "\n".join(
        import_line(module, by_module[module]) for module in sorted(by_module, key=_natural)
    )


def import_line(module: str, names: Iterable[str]) -> str:
    """One `from module import ...`, in brackets where it would be too long for a line."""
    ordered = sorted(names, key=_member_key)
    line = f"from {module} import {', '.join(ordered)}"
    if len(line) <= LINE_LENGTH:
        return line
    return "\n".join([f"from {module} import (", *(f"    {name}," for name in ordered), ")"])


def _member_key(name: str) -> tuple[object, ...]:
    """Constants, then classes, then the rest, as isort's `order-by-type` has it."""
    rank = 0 if name.isupper() and len(name) > 1 else 1 if name[0].isupper() else 2
    return (rank, *_natural(name))


def _natural(name: str) -> tuple[object, ...]:
    """A key under which `Int8` comes before `Int16`."""
    parts = re.split(r"(\d+)", name)
    return tuple(int(part) if part.isdigit() else part.lower() for part in parts)
