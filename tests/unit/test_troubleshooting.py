"""docs/troubleshooting.md quotes messages of the source."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from ..parsed import parsed  # noqa: TID252 - shared by folders of tests

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "troubleshooting.md"
ROW = re.compile(r"^\| (?P<marks>`+)(?P<quote>.+?)(?P=marks)[ |]", re.MULTILINE)
QUOTES = [row["quote"].strip() for row in ROW.finditer(PAGE.read_text(encoding="utf-8"))]


def template(node: ast.expr) -> str:
    """A string in the source, with placeholders as `…`."""
    if isinstance(node, ast.JoinedStr):
        return re.sub("…+", "…", "".join(map(template, node.values)))
    return str(node.value) if isinstance(node, ast.Constant) else "…"


def templates() -> Iterator[str]:
    """All strings in the source except docstrings."""
    for path in (ROOT / "src").rglob("*.py"):
        for statement in ast.walk(parsed(path)):
            for node in ast.iter_child_nodes(statement):
                is_docstring = isinstance(statement, ast.Expr) and isinstance(node, ast.Constant)
                if isinstance(node, ast.JoinedStr | ast.Constant) and not is_docstring:
                    yield template(node)


def test_every_row_is_read() -> None:
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:3] == "| `"]
    assert len(QUOTES) == len(rows) > 50


def test_the_source_has_every_quoted_message() -> None:
    assert all(len(re.findall(r"\w", quote)) >= 6 for quote in QUOTES)
    source = "\n".join(templates())
    assert [quote for quote in QUOTES if quote not in source] == []
