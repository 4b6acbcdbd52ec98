"""Lines that start in another column than those they belong to."""

import re
from collections.abc import Iterator

from obelisk_spec.wording import with_number
from obk_cli.diagnostics import Related
from obk_cli.source import SourceFile, Span
from obk_cli.yaml_faults.trouble import Cause, Trouble, indent_of

__all__ = ["find_in_columns"]

_DASHES = re.compile(r"(\s*)((?:- +)*)")
_MOST_LINES = 200
"""Lines above the mistake that are looked at."""


def find_in_columns(trouble: Trouble) -> Cause | None:
    """The mistake, if it is in how lines are indented."""
    if trouble.problem.startswith("mapping values are not allowed"):
        return _deeper(trouble)
    if not trouble.context.startswith("while parsing a block") or not trouble.rest:
        return None
    if indent_of(trouble.text) + 1 != trouble.column:
        return None
    is_item = trouble.rest == "-" or trouble.rest.startswith("- ")
    kind = "dash" if is_item else "key"
    starts = list(_starts(trouble.source, trouble.line))
    same = [line for line, column, what in starts if (column, what) == (trouble.column, kind)]
    if is_item and (trouble.context_place or (0, 0))[1] == trouble.column and not same:
        return _item_among_keys(trouble)
    return _no_such_column(trouble, kind, starts)


def _deeper(trouble: Trouble) -> Cause | None:
    """A key below a value, deeper than the value's key: one of the two is in a wrong column."""
    scalar = trouble.before.scalar
    if scalar is None or not trouble.before.is_plain or scalar.line >= trouble.line:
        return None
    above = _starts_of(trouble.source, scalar.line)[-1]
    column = indent_of(trouble.text) + 1
    outer = [start for start in _starts(trouble.source, scalar.line) if start[2] == "key"]
    if any(start[1] == column for start in outer[:1]):
        # The key fits to what stands further up, so that the line between is the odd one.
        return _differs(trouble.source, (scalar.line, above[1]), outer[0][:2])
    return _differs(trouble.source, (trouble.line, column), above[:2])


def _item_among_keys(trouble: Trouble) -> Cause:
    assert trouble.context_place is not None  # it was compared with
    return Cause(
        message="an item of a list (`-`) stands among the keys of a mapping",
        span=trouble.span,
        help="what holds items holds nothing else: give every key below it a dash too, or none",
        related=Related(
            message="the mapping", span=Span.at(trouble.source, *trouble.context_place)
        ),
    )


def _no_such_column(trouble: Trouble, kind: str, starts: list[tuple[int, int, str]]) -> Cause:
    near = [s for s in starts if s[2] == kind and s[1] != trouble.column]
    if not near:
        return Cause(
            message=f"this line starts in column {trouble.column}, as none above it does",
            span=trouble.span,
            help="the lines of one mapping or list start in the same column",
        )
    line, column, _ = min(near, key=lambda s: (abs(s[1] - trouble.column), -s[0]))
    odd = _line_between(trouble, kind) if abs(column - trouble.column) > 2 else None
    if odd is not None:
        return _differs(trouble.source, *odd)
    return _differs(trouble.source, (trouble.line, trouble.column), (line, column))


def _line_between(trouble: Trouble, kind: str) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """A line too far left, below one to which the place fits; and that one."""
    odd: tuple[int, int] | None = None
    for number in range(trouble.line - 1, max(trouble.line - 1 - _MOST_LINES, 0), -1):
        text = trouble.source.line(number)
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        for _, column, what in _starts_of(trouble.source, number):
            if (column, what) == (trouble.column, kind):
                return (odd, (number, column)) if odd else None
        if indent_of(text) + 1 < trouble.column:
            if odd is not None:
                return None
            odd = (number, indent_of(text) + 1)
    return None


def _differs(source: SourceFile, wrong: tuple[int, int], right: tuple[int, int]) -> Cause:
    (line, column), (other, wanted) = wrong, right
    way = "right" if column < wanted else "left"
    return Cause(
        message=f"this line starts in column {column}, its neighbour in line {other} in column "
        f"{wanted}",
        span=Span.at(source, line, column),
        help=f"move it {with_number(abs(wanted - column), 'space')} to the {way}: the lines of one "
        "mapping or list start in the same column",
        related=Related(message="its neighbour", span=Span.at(source, other, wanted)),
    )


def _starts(source: SourceFile, line: int) -> Iterator[tuple[int, int, str]]:
    """Line, column and kind of what the lines above start with, nearest first, outer ones only."""
    narrowest = 10**9
    for number in range(line - 1, max(line - 1 - _MOST_LINES, 0), -1):
        text = source.line(number)
        if not text.strip() or text.lstrip().startswith("#") or indent_of(text) >= narrowest:
            continue
        for start in reversed(_starts_of(source, number)):
            if start[1] < narrowest or start[2] == "dash":
                yield start
        narrowest = indent_of(text)


def _starts_of(source: SourceFile, line: int) -> list[tuple[int, int, str]]:
    """The dashes of a line, and the key behind them."""
    text = source.line(line)
    match = _DASHES.match(text)
    assert match is not None  # it matches nothing, too
    dashes = [(line, m.start() + match.end(1) + 1, "dash") for m in re.finditer("-", match[2])]
    return [*dashes, (line, match.end() + 1, "key")]
