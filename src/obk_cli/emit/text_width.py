"""Text fit to be shown in a picture: without what cannot be drawn, measured, shortened."""

import unicodedata

__all__ = ["columns_of", "printable", "shortened"]

_ELLIPSIS = "\u2026"


def printable(text: str) -> str:
    """The text with what no picture can show, line ends among it, replaced."""
    return "".join("\ufffd" if _is_unshowable(c) else c for c in text)


def columns_of(text: str) -> int:
    """How many letters of one width the text takes."""
    return sum(_columns(letter) for letter in text)


def shortened(text: str, most: int) -> str:
    """The text in at most so many columns (at least 2), its middle left out if need be."""
    if columns_of(text) <= most:
        return text
    end = _first_letters(text[::-1], (most - 1) // 2)[::-1]
    return _first_letters(text, most - 1 - columns_of(end)) + _ELLIPSIS + end


def _is_unshowable(letter: str) -> bool:
    # The last two are no characters to XML, not even by number.
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
