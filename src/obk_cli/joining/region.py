"""How far a key or a list item reaches in the user's text, comments counted to whom they belong.

A tree with places in; lines out. What came by an alias or a merge has no stretch of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from obk_cli.config.fixes import is_flow
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap
from obk_cli.diagnostics.source import SourceFile, Span, indent_of
from obk_cli.joining.style import is_flow_list

__all__ = ["Regions", "is_blank", "is_comment"]


@dataclass(frozen=True, slots=True)
class Regions:
    """The stretches of one text, in lines from 1."""

    source: SourceFile
    tree: TreeMap

    def limit_of(self, entry: Entry) -> int:
        """The first line that is not the entry's any more: of the next key, or past the end."""
        line, column = entry.key_span.line, entry.key_span.column
        later = (s.line for s in _keys(self.tree) if s.line > line and s.column <= column)
        return min(later, default=self.end)

    def last_line_of(self, entry: Entry) -> int:
        """The last line of an entry with the comments that are deeper than its key."""
        first = entry.key_span.line
        return self.last_line(first, self.limit_of(entry), entry.key_span.column - 1)

    def last_line(self, first: int, limit: int, indent: int) -> int:
        """The last line from `first` on with content, or with a comment deeper than `indent`."""
        last = first
        for number in range(first + 1, limit):
            line = self.source.line(number)
            if not is_blank(line) and (not is_comment(line) or indent_of(line) > indent):
                last = number
        return last

    @property
    def end(self) -> int:
        """The line past the document: of a marker that ends it, or past the text."""
        marked = (
            number
            for number in range(self.tree.span.line, len(self.source.lines) + 1)
            if self.source.line(number).startswith(("...", "---"))
        )
        return next(marked, len(self.source.lines) + 1)


def is_blank(line: str) -> bool:
    """Whether a line holds nothing."""
    return not line.strip()


def is_comment(line: str) -> bool:
    """Whether a line holds a comment alone."""
    return line.lstrip().startswith("#")


def _keys(tree: Tree) -> Iterator[Span]:
    """The keys of every block mapping."""
    if isinstance(tree, TreeMap) and not is_flow(tree):
        for entry in tree:
            yield entry.key_span
            yield from _keys(entry.value)
    elif isinstance(tree, TreeList) and not is_flow_list(tree):
        for item in tree.items:
            yield from _keys(item)
