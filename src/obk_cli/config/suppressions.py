"""Findings that the user ignores: `--ignore`, `obk: {ignore: [...]}`, comments on a line.

Errors that prevent a plan are always reported. A code without effect is itself a finding.
"""

import re
from collections.abc import Collection, Iterable, Iterator

from obelisk_spec.suggestions import ask_for, near_names
from obk_cli.config.model import Spanned
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.rules import RULES, Rule
from obk_cli.diagnostics.source import COMMAND_LINE, SourceFile, Span

__all__ = [
    "check_ignores",
    "ignored_on_line",
    "may_be_silenced",
    "near_codes",
    "said_on_command_line",
    "silence",
]

_MOST_SUGGESTIONS = 50
"""Maximum number of findings that suggest a similar code."""
_COMMENT = re.compile(r"#\s*obk:\s*ignore\[([^\]#]*)\]")
_DIGITS_FOR_LETTERS = str.maketrans("OIL", "011")
_NEARLY_ONE = re.compile(r"(?:^|\s)#\s*obk:\s*([\w-]+)")
_MAY_BE_SILENCED = ("OBK101", "OBK107", "OBK108", "OBK115", "OBK2", "OBK3", "OBK4", "OBK5")


def silence(diagnostics: Collection[Diagnostic], codes: Iterable[str]) -> tuple[Diagnostic, ...]:
    """The remaining findings; a code silences every code that starts with it (`OBK4`)."""
    prefixes = tuple(code for code in codes if code)
    on_line: dict[tuple[str, int], tuple[str, ...]] = {}
    for diagnostic in diagnostics:
        place = (diagnostic.span.path, diagnostic.span.line)
        if place not in on_line:  # a line may be long, with many findings
            on_line[place] = ignored_on_line(diagnostic.span)
    return tuple(
        diagnostic
        for diagnostic in diagnostics
        if not diagnostic.code.startswith(
            (*prefixes, *on_line[diagnostic.span.path, diagnostic.span.line])
        )
        or (diagnostic.severity == "error" and not diagnostic.code.startswith(_MAY_BE_SILENCED))
    )


def may_be_silenced(rule: Rule) -> bool:
    """Whether the user may ignore the findings of a rule."""
    return rule.severity != "error" or rule.code.startswith(_MAY_BE_SILENCED)


def said_on_command_line(code: str) -> Spanned[str]:
    """A code of `--ignore`, with a location for messages."""
    before = "--ignore "
    source = SourceFile.of(COMMAND_LINE, before + code)
    return Spanned(code, Span.at(source, 1, len(before) + 1, max(len(code), 1)))


def check_ignores(
    sources: Iterable[SourceFile], codes: Iterable[Spanned[str]]
) -> tuple[Diagnostic, ...]:
    """OBK014: ignored codes that do not exist, or whose findings must be reported.

    `codes` are those of the run and of the config; codes in comments are in the sources.
    """
    faults: list[Diagnostic] = []
    written = list(codes)
    for source in sources:
        if "obk:" in source.text:
            written += _codes_in_comments(source)
            faults += _misspelt_comments(source)
    for code in written:
        fault = _check_code(code, is_compared=len(faults) < _MOST_SUGGESTIONS)
        faults += (fault,) if fault else ()
    return tuple(faults)


def _check_code(code: Spanned[str], *, is_compared: bool) -> Diagnostic | None:
    meant = [rule for rule in RULES.values() if code.value and rule.code.startswith(code.value)]
    if any(map(may_be_silenced, meant)):
        return None
    if meant:
        help = "the config cannot be used with this error; fix it instead"
        return found("OBK014", f"`{code.value}` cannot be silenced", code.span, help=help)
    message = f"unknown rule `{code.value}`"
    near = near_codes(code.value) if is_compared else None
    return found("OBK014", message, code.span, help=near)


def near_codes(code: str) -> str:
    """A help line with similar codes for an unknown code."""
    looks_like = code[:3].upper() + code[3:].upper().translate(_DIGITS_FOR_LETTERS)
    if looks_like in RULES:
        return f"did you mean `{looks_like}`?"
    return ask_for(near_names(code, RULES)) or "list the rules with `obk explain`"


def _codes_in_comments(source: SourceFile) -> Iterator[Spanned[str]]:
    for number, line in enumerate(source.lines, 1):
        comment = _COMMENT.search(line)
        for part in re.finditer(r"[^,\s][^,]*", comment[1]) if comment else ():
            code = part[0].strip()
            column = comment.start(1) + part.start() + 1 if comment else 1
            yield Spanned(code, Span.at(source, number, column, len(code)))


def _misspelt_comments(source: SourceFile) -> Iterator[Diagnostic]:
    for number, line in enumerate(source.lines, 1):
        word = _NEARLY_ONE.search(line)
        if word and not _COMMENT.search(line) and near_names(word[1], ["ignore"]):
            place = Span.at(source, number, word.start(1) + 1, len(word[1]))
            message = "this comment silences nothing"
            yield found("OBK014", message, place, help="write it as `# obk: ignore[OBK203]`")


def ignored_on_line(span: Span) -> tuple[str, ...]:
    """The codes in a comment on the first line of a location."""
    comment = _COMMENT.search(span.source.line(span.line))
    if comment is None:
        return ()
    return tuple(code for part in comment[1].split(",") if (code := part.strip()))
