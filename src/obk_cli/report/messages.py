"""Messages for a person, as YAML with long arrays cut, as rows of CSV, and as lines of JSON."""

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from obk_cli.introspect.message_dict import Plain
from obk_cli.report.escapes import escaped

__all__ = ["MOST_ITEMS", "MOST_LETTERS", "csv_row", "json_line", "message_text"]

MOST_ITEMS: Final = 12
"""Of an array, for a person."""
MOST_LETTERS: Final = 200
"""Of a text, for a person."""


def message_text(value: Plain, *, is_whole: bool) -> Iterator[str]:
    """The lines of a message, or of a value in one.

    Args:
        value: plain data.
        is_whole: whether long arrays and texts are shown to their end.
    """
    if isinstance(value, dict):
        yield from _fields(value, is_whole) if value else ("{}",)
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        yield from _items(value, is_whole)
    else:
        yield _flow(value, is_whole)


def csv_row(values: Iterable[Plain]) -> str:
    """One row of single values, without its line break; what is None is empty."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow([_cell(value) for value in values])
    return line.getvalue()


def json_line(value: Plain) -> str:
    """The value on one line; numbers that JSON has not are the texts `nan`, `inf`, `-inf`."""
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value))


def _fields(message: Mapping[str, Plain], is_whole: bool) -> Iterator[str]:
    for name, value in message.items():
        first, *rest = message_text(value, is_whole=is_whole)
        is_block = isinstance(value, dict) and value
        if is_block or first.startswith("- "):
            yield f"{name}:"
            yield from (f"  {line}" for line in (first, *rest))
        else:
            yield f"{name}: {first}"


def _items(items: list[Plain], is_whole: bool) -> Iterator[str]:
    shown = items if is_whole else items[:MOST_ITEMS]
    for item in shown:
        first, *rest = message_text(item, is_whole=is_whole)
        yield f"- {first}"
        yield from (f"  {line}" for line in rest)
    if len(shown) < len(items):
        yield f"# and {len(items) - len(shown)} more"


def _flow(value: Plain, is_whole: bool) -> str:
    if isinstance(value, list):
        shown = value if is_whole else value[:MOST_ITEMS]
        more = [f"... {len(value) - len(shown)} more"] if len(shown) < len(value) else []
        return f"[{', '.join([*(_flow(item, is_whole) for item in shown), *more])}]"
    if isinstance(value, str):
        text = value if is_whole or len(value) <= MOST_LETTERS else f"{value[:MOST_LETTERS]}..."
        return escaped(json.dumps(text, ensure_ascii=False))
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float) and not math.isfinite(value):
        return f"{value}".replace("nan", ".nan").replace("inf", ".inf")
    return f"{value}"


def _cell(value: Plain) -> Plain:
    if isinstance(value, bool):
        return "true" if value else "false"
    return escaped(value) if isinstance(value, str) else value


def _finite(value: Plain) -> Plain:
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
