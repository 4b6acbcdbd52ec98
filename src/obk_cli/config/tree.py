"""YAML values with their locations, frozen.

They are created by parsing and changed by resolving references. Every value, including `true` and
null, keeps the span of the text that defined it, in whichever file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from obk_cli.diagnostics.source import Span

if TYPE_CHECKING:
    from obelisk_spec.yaml_core import Scalar

__all__ = ["Entry", "Tree", "TreeList", "TreeMap", "TreeScalar", "kind_of", "plain_value", "shown"]


@dataclass(frozen=True, slots=True)
class TreeScalar:
    """Text, a number, a boolean or null."""

    value: "Scalar"
    span: Span
    read_from: str | None = None
    """The original text, if variables in it were replaced."""

    @property
    def text(self) -> str:
        """The text, with its variables replaced."""
        return self.span.text if self.read_from is None else self.read_from


@dataclass(frozen=True, slots=True)
class TreeList:
    """A list."""

    items: tuple["Tree", ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Entry:
    """One key of a mapping with its value."""

    key: str
    key_span: Span
    value: "Tree"


@dataclass(frozen=True, slots=True)
class TreeMap:
    """A mapping; its keys are unique strings in the order of the file."""

    entries: tuple[Entry, ...]
    span: Span
    _by_key: Mapping[str, Entry] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_key", {entry.key: entry for entry in self.entries})

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def get(self, key: str) -> Entry | None:
        """The entry with this key."""
        return self._by_key.get(key)


Tree = TreeScalar | TreeList | TreeMap


def plain_value(tree: Tree) -> object:
    """The value without locations: dict, list or scalar."""
    match tree:
        case TreeMap():
            return {entry.key: plain_value(entry.value) for entry in tree.entries}
        case TreeList():
            return [plain_value(item) for item in tree.items]
        case TreeScalar():
            return tree.value


def kind_of(tree: Tree) -> str:
    """Describe a value with an article, for messages: "a list", "the string `x`"."""
    match tree:
        case TreeMap():
            return "a mapping"
        case TreeList():
            return "a list"
        case TreeScalar(value=None | ""):
            return "empty"
        case TreeScalar(value=bool() as truth):
            return "true" if truth else "false"
        case TreeScalar(value=int() | float() as number):
            return f"the number {shown(number)}"
        case TreeScalar(value=text):
            return f"the string `{shown(text)}`"


def shown(value: object) -> str:
    """A value, shortened for a message."""
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
