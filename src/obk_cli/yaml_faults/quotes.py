"""Quotes that are left open, that close too early, or that hold a wrong escape."""

from obk_cli.source import Span
from obk_cli.yaml_faults.trouble import Cause, Trouble, without_comment

__all__ = ["find_in_quotes"]

_CLOSED_BY = ",]}"


def find_in_quotes(trouble: Trouble) -> Cause | None:
    """The mistake, if it is one with quotes."""
    if "quoted scalar" in trouble.context and trouble.context_place:
        if "escape" in trouble.problem:
            return _escape(trouble)
        return _never_closed(Span.at(trouble.source, *trouble.context_place))
    scalar = trouble.before.scalar
    is_quoted = scalar is not None and not trouble.before.is_plain and scalar.text[:1] in ("'", '"')
    if not is_quoted or scalar is None or trouble.line != scalar.end_line:
        return None
    between = trouble.text[scalar.end_column - 1 : trouble.column - 1]
    if between.strip() or trouble.rest[:1] in ("", ":", ",", "]", "}"):
        return None
    if scalar.end_line > scalar.line:
        return _closed_elsewhere(scalar)
    return _goes_on(scalar, trouble)


def _never_closed(place: Span) -> Cause:
    line = place.source.line(place.line)
    quote = line[place.column - 1]
    written = without_comment(line[place.column - 1 :])
    return Cause(
        message=f"the quote {quote} that opens here is never closed",
        span=Span.at(place.source, place.line, place.column, max(len(written), 1)),
        help=f"close it: {_closed(written, quote)}" if written.strip(quote) else None,
    )


def _closed(written: str, quote: str) -> str:
    """What was written with its closing quote, which goes before what closes a list around it."""
    value = written.rstrip(_CLOSED_BY)
    return f"`{value}{quote}{written[len(value) :]}`"


def _closed_elsewhere(scalar: Span) -> Cause:
    cause = _never_closed(scalar)
    quote = scalar.text[0]
    return Cause(
        message=f"the quote {quote} that opens here is closed only in line {scalar.end_line}, "
        "by one that was to open",
        span=cause.span,
        help=cause.help,
    )


def _goes_on(scalar: Span, trouble: Trouble) -> Cause:
    """`"a"b`, and `'robot's'`."""
    quote, inner = scalar.text[0], scalar.text[1:-1]
    rest = without_comment(trouble.text[scalar.end_column - 1 :])
    if quote == "'" and rest.endswith("'"):
        help = f'an apostrophe stands within double quotes: `"{inner}\'{rest[:-1]}"`'
    elif quote == '"' and rest.endswith('"'):
        help = f"a double quote stands within single quotes: `'{inner}\"{rest[:-1]}'`"
    else:
        help = f"put all of it in quotes: `{quote}{inner}{rest}{quote}`"
    return Cause(
        message=f"`{rest.strip()}` follows the quote {quote} that ends the value",
        span=trouble.span,
        help=help,
    )


def _escape(trouble: Trouble) -> Cause:
    start = trouble.text.rfind("\\", 0, trouble.column + 1)
    written = trouble.text[start : start + 2] if start >= 0 else "\\"
    return Cause(
        message=f"`{written}` is no escape of YAML's",
        span=Span.at(trouble.source, trouble.line, max(start, 0) + 1, 2),
        help="within double quotes a backslash is written `\\\\`; within single quotes it is "
        "itself",
    )
