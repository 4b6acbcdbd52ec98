"""Strategies for hostile input: valid files with changed bytes, JSON of any shape, odd strings."""

import string
from collections.abc import Sequence

from hypothesis import strategies as st

__all__ = ["JSON", "SPOILT", "assert_shows_only_text", "damaged", "respelt"]

_CONTROLS = frozenset(map(chr, (*range(0x20), *range(0x7F, 0xA0)))) - {"\t"}
_SEQUENCES = (
    *("\x1b[2J", "\x1b]0;title\x07", "\x1b]52;c;eA==\x07", "\x1bP$q\x1b\\", "\x1b[31m", "\x1bc"),
    *("\x9b2J", "\x9d0;t\x9c", "\r", "\x07", "\x08", "\n", "\x00", "\x7f", "\x1b[", "\x1b"),
)
SPOILT = st.lists(
    st.sampled_from(_SEQUENCES) | st.text(string.ascii_letters + ";[]?0m \t", max_size=6),
    max_size=8,
).map("".join)
"""Texts that contain terminal control sequences."""
_WORDS = st.sampled_from(("", "a", "/a", "../..", "active", "\ud800", "nan", "a" * 300))
_NUMBERS = st.sampled_from((0, 1, -1, 2**31, 2**63, 2**64, 10**400, 1e308, 0.5, -0.0))
JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | _NUMBERS
    | _WORDS
    | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_WORDS, inner, max_size=3),
    max_leaves=8,
)
"""Values of any shape, some of which are invalid in JSON."""
_LENGTHS = tuple(
    n.to_bytes(size, "little")
    for size in (1, 2, 4, 8)
    for n in (
        0,
        1,
        255,
        2 ** (8 * size) - 1,
        2 ** (8 * size - 1),
        10 ** (2 * size) % 2 ** (8 * size),
    )
)
_PIECES = st.sampled_from(_LENGTHS) | st.binary(max_size=8)
_EDITS = st.lists(
    st.tuples(st.sampled_from("cut drop set add twice".split()), st.floats(0, 1), _PIECES),
    min_size=1,
    max_size=6,
)


def damaged(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Valid files with up to six parts truncated, removed, overwritten, extended or repeated."""
    return st.tuples(st.sampled_from(tuple(seeds)), _EDITS).map(lambda drawn: _edited(*drawn))


def _edited(data: bytes, edits: Sequence[tuple[str, float, bytes]]) -> bytes:
    for kind, part, piece in edits:
        at = int(part * len(data))
        if kind == "cut":
            data = data[: at + len(piece)]
        elif kind == "drop":
            data = data[:at] + data[at + len(piece) :]
        elif kind == "set":
            data = data[:at] + piece + data[at + len(piece) :]
        elif kind == "add":
            data = data[:at] + piece + data[at:]
        else:
            data = data[: at + 64] + data[at:]
    return data


def respelt(sound: object) -> st.SearchStrategy[object]:
    """A valid JSON value in which up to three parts have any shape."""
    changes = st.lists(st.tuples(st.sampled_from(_places(sound)), JSON), max_size=3)
    return changes.map(lambda drawn: _changed(sound, drawn))


def _places(value: object) -> list[tuple[str | int, ...]]:
    """The paths to all parts of a JSON value, starting with its own."""
    if isinstance(value, dict):
        held = list(value.items())
    else:
        held = list(enumerate(value)) if isinstance(value, list) else []
    return [(), *((key, *rest) for key, part in held for rest in _places(part))]


def _changed(value: object, changes: Sequence[tuple[tuple[str | int, ...], object]]) -> object:
    for place, part in changes:
        value = _with_part(value, place, part)
    return value


def _with_part(value: object, place: tuple[str | int, ...], part: object) -> object:
    if not place:
        return part
    if isinstance(value, dict):
        return {**value, place[0]: _with_part(value.get(place[0]), place[1:], part)}
    if isinstance(value, list) and isinstance(place[0], int) and place[0] < len(value):
        at = place[0]
        return [*value[:at], _with_part(value[at], place[1:], part), *value[at + 1 :]]
    return value


def assert_shows_only_text(lines: str | Sequence[str]) -> None:
    """Assert that no character of the lines, except line breaks between them, moves the cursor."""
    for line in [lines] if isinstance(lines, str) else lines:
        assert not _CONTROLS & set(line), repr(line)
