"""Where and why PyYAML stopped, with the surrounding text.

Pure; `yaml_errors` finds the cause.
"""

import re
from dataclasses import dataclass

import yaml

from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.edits import Offsets
from obk_cli.diagnostics.source import SourceFile, Span

__all__ = [
    "LONGEST_LINE",
    "YAML_LOADER",
    "ErrorContext",
    "YamlText",
    "forbidden_character",
    "indent_of",
    "without_comment",
]

YAML_LOADER = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
"""The faster of PyYAML's two safe parsers."""

_BREAKS_OF_YAML_1_1 = "\x85\u2028\u2029"
_PRIVATE_USE = range(0xE000, 0xF8FF)

_UNUSUAL = re.compile("[^\t\n\r\x20-\x7e]")
_FORBIDDEN = "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
"""Compiled only for text with unusual characters, because that takes 5 ms."""


class YamlText:
    """Source text prepared for PyYAML, which treats some characters as line breaks as in YAML 1.1.

    These are replaced one for one, so that locations do not change.
    """

    __slots__ = ("_restored", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._restored: dict[int, str] = {}
        if any(char in text for char in _BREAKS_OF_YAML_1_1):
            taken = set(text)
            free = (code for code in _PRIVATE_USE if chr(code) not in taken)
            self._restored = dict(zip(free, _BREAKS_OF_YAML_1_1, strict=False))
            self.text = text.translate({ord(char): code for code, char in self._restored.items()})

    def restored(self, value: str) -> str:
        """A value read from the prepared text, in the user's characters."""
        return value.translate(self._restored) if self._restored else value


def forbidden_character(source: SourceFile) -> Diagnostic | None:
    """The first character that YAML does not allow, such as a control character."""
    wrong = _UNUSUAL.search(source.text) and re.search(_FORBIDDEN, source.text)
    if wrong is None:
        return None
    before = SourceFile.of(source.path, source.text[: wrong.start()]).lines
    return found(
        "OBK003",
        f"character U+{ord(wrong[0]):04X} is not allowed in YAML",
        Span.at(source, len(before), len(before[-1]) + 1),
        help='write it as an escape in double quotes, such as "\\x07"',
    )


LONGEST_LINE = 1_000
"""Maximum line length in which causes are searched [characters]."""

_COMMENT = re.compile(r"\s+#.*$")
_OPENING = (yaml.FlowSequenceStartToken, yaml.FlowMappingStartToken)
_CLOSING = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadBefore:
    """What was read before the error."""

    scalar: Span | None = None
    """The last value or key, including its quotes."""
    is_plain: bool = False
    """Whether it is written without quotes."""
    bracket: Span | None = None
    """The innermost bracket or brace that is still open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorContext:
    """The location where the parser detected a mistake, and what it expected there."""

    source: SourceFile
    problem: str
    context: str
    line: int
    column: int
    context_place: tuple[int, int] | None
    before: ReadBefore

    @classmethod
    def of(cls, error: yaml.MarkedYAMLError, source: SourceFile) -> "ErrorContext":
        """The context of an error in this source."""
        mark = error.problem_mark or error.context_mark
        line, column = _within(source, (mark.line + 1, mark.column + 1) if mark else (1, 1))
        context = error.context_mark
        return cls(
            source=source,
            problem=error.problem or "the text ends unexpectedly",
            context=error.context or "",
            line=line,
            column=column,
            context_place=(
                _within(source, (context.line + 1, context.column + 1)) if context else None
            ),
            before=_before(source, line, column),
        )

    @property
    def span(self) -> Span:
        """The location where it was detected."""
        return Span.at(self.source, self.line, self.column)

    def at(self, line: int, column: int, length: int = 1) -> Span:
        """A location in the same source."""
        return Span.at(self.source, line, column, length)

    @property
    def text(self) -> str:
        """The line where it was detected."""
        return self.source.line(self.line)

    @property
    def rest(self) -> str:
        """The text from that location to the end of the line."""
        return self.text[self.column - 1 :].rstrip()

    @property
    def is_short(self) -> bool:
        """Whether all lines involved are short enough to be typed by a person."""
        lines = {self.line, self.line - 1}
        lines |= {self.context_place[0]} if self.context_place else set()
        lines |= {self.before.scalar.line} if self.before.scalar else set()
        lines |= {self.before.bracket.line} if self.before.bracket else set()
        return all(len(self.source.line(number)) <= LONGEST_LINE for number in lines)

    @property
    def is_at_end(self) -> bool:
        """Whether no text follows on that line or below."""
        return not self.rest and not any(self.source.lines[self.line :])


def indent_of(text: str) -> int:
    """Number of spaces at the start of a line."""
    return len(text) - len(text.lstrip())


def without_comment(text: str) -> str:
    """The text without a trailing comment and trailing spaces."""
    return _COMMENT.sub("", text.rstrip())


def _within(source: SourceFile, place: tuple[int, int]) -> tuple[int, int]:
    line, column = place
    if line > len(source.lines):
        line, column = len(source.lines), len(source.lines[-1]) + 1
    return line, min(column, len(source.line(line)) + 1)


def _before(source: SourceFile, line: int, column: int) -> ReadBefore:
    """Parse the text up to the error again, as if it ended there."""
    text = source.text[: Offsets.of(source).at(line, column)]
    scalar: yaml.ScalarToken | None = None
    opened: list[yaml.Token] = []
    try:
        for token in yaml.scan(YamlText(text).text, Loader=YAML_LOADER):
            if isinstance(token, yaml.ScalarToken):
                scalar = token
            elif isinstance(token, _OPENING):
                opened.append(token)
            elif isinstance(token, _CLOSING) and opened:
                opened.pop()
    except yaml.YAMLError:
        pass  # what was read before it is enough
    return ReadBefore(
        scalar=_span(source, scalar) if scalar else None,
        is_plain=scalar is not None and scalar.plain,
        bracket=_span(source, opened[-1]) if opened else None,
    )


def _span(source: SourceFile, token: yaml.Token) -> Span:
    start, end = token.start_mark, token.end_mark
    return Span(source, start.line + 1, start.column + 1, end.line + 1, end.column + 1)
