"""Text for terminals: escape control characters, measure and pad by display width."""

import re
import unicodedata
from typing import Final

__all__ = ["columns_of", "escaped", "only_colour", "plain", "printable", "shortened", "visible"]

_SEQUENCE: Final = re.compile(
    r"(?P<colour>\x1b\[[0-9;:]*m)"
    r"|(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]?"  # control sequences
    r"|(?:\x1b[\]PX^_]|[\x9d\x90\x98\x9e\x9f])[^\x07\x1b\x9c]*(?:\x07|\x1b\\|\x9c)?"  # strings
    r"|\x1b[ -/]*[0-~]?"  # other two-character sequences
    r"|[\x00-\x08\x0a-\x1f\x7f-\x9f\ud800-\udfff]"  # including unpaired surrogates
)
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters that a terminal executes, or that break lines or change the writing direction."""
_INVISIBLE: Final = re.compile(
    r"[\x00-\x08\x0a-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
_NAMES: Final = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}
_RESET: Final = "\x1b[0m"


def only_colour(text: str) -> str:
    """The text without sequences that move, clear, rename or query the terminal.

    Colors are kept, and end with the text.
    """
    kept = _SEQUENCE.sub(lambda match: match["colour"] or "", text)
    return kept + _RESET if "\x1b" in kept and not kept.endswith(_RESET) else kept


def plain(text: str) -> str:
    """The text without escape sequences, control characters and invalid bytes."""
    return _SEQUENCE.sub("", text)


def visible(text: str) -> str:
    """The text with a visible sign for each control character except tabs; columns are kept."""
    return _INVISIBLE.sub("\ufffd", text)


def escaped(text: str) -> str:
    """The text on one line, with control characters escaped as in JSON."""
    return _CONTROL.sub(lambda match: _NAMES.get(match[0]) or f"\\u{ord(match[0]):04x}", text)


_ELLIPSIS = "\u2026"


def printable(text: str) -> str:
    """The text with everything that a picture cannot show replaced, including line ends."""
    return "".join("\ufffd" if _is_unshowable(c) else c for c in text)


def columns_of(text: str) -> int:
    """Display width of the text [columns]."""
    return sum(_columns(letter) for letter in text)


def shortened(text: str, most: int) -> str:
    """The text in at most `most` columns (at least 2); the middle is left out if necessary."""
    if columns_of(text) <= most:
        return text
    end = _first_letters(text[::-1], (most - 1) // 2)[::-1]
    return _first_letters(text, most - 1 - columns_of(end)) + _ELLIPSIS + end


def _is_unshowable(letter: str) -> bool:
    # XML does not allow the last two, not even as character references.
    return unicodedata.category(letter) in ("Cc", "Cs") or letter in "\ufffe\uffff"


def _first_letters(text: str, most: int) -> str:
    used = 0
    for i, letter in enumerate(text):
        used += _columns(letter)
        if used > most:
            return text[:i]
    return text


def _columns(letter: str) -> int:
    if unicodedata.combining(letter) or unicodedata.category(letter) == "Cf":
        return 0
    return 2 if unicodedata.east_asian_width(letter) in "WF" else 1
