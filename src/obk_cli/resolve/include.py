"""`include:` followed through all files. Loading a file is the caller's; this opens none."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath

from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.resolve.merge import merge_trees
from obk_cli.source import Span
from obk_cli.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of

__all__ = ["Load", "Loaded", "resolve_includes"]

_MOST_INCLUDED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """What a file held; `unreadable` says why it could not be opened."""

    tree: Tree | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    unreadable: str | None = None


Load = Callable[[str], Loaded]
"""From the path of a file to what it holds."""


def resolve_includes(
    tree: TreeMap, path: str, load: Load
) -> tuple[TreeMap, tuple[Diagnostic, ...]]:
    """The tree with everything that it includes merged under it, and without `include:`."""
    resolver = _Resolver(load)
    merged = resolver.resolve(tree, ((_normal(path), tree.span),))
    return merged, tuple(resolver.faults)


Chain = tuple[tuple[str, Span], ...]
"""The files that are open, outermost first, each with the place that named it."""


class _Resolver:
    def __init__(self, load: Load) -> None:
        self.faults: list[Diagnostic] = []
        self._load = load
        self._included = 0

    def resolve(self, tree: TreeMap, chain: Chain) -> TreeMap:
        include = tree.get("include")
        if include is None:
            return tree
        outer = replace(tree, entries=tuple(e for e in tree if e.key != "include"))
        merged: TreeMap | None = None
        for path, span in self._paths(include):
            fragment = self._fragment(path, span, chain)
            if fragment is not None:
                over = fragment if merged is None else merge_trees(merged, fragment)
                merged = over if isinstance(over, TreeMap) else merged
        whole = outer if merged is None else merge_trees(merged, outer)
        return whole if isinstance(whole, TreeMap) else outer

    def _paths(self, include: Entry) -> Iterator[tuple[str, Span]]:
        value = include.value
        items = value.items if isinstance(value, TreeList) else (value,)
        for item in items:
            if isinstance(item, TreeScalar) and item.value == "":
                self.faults.append(found("OBK103", "a path of `include` is empty", item.span))
            elif isinstance(item, TreeScalar) and isinstance(item.value, str):
                yield item.value, item.span
            elif not (isinstance(item, TreeScalar) and item.value is None):
                message = f"`include` holds {kind_of(item)}, expected paths"
                self.faults.append(found("OBK103", message, item.span))

    def _fragment(self, written: str, span: Span, chain: Chain) -> TreeMap | None:
        path = _normal(str(PurePath(chain[-1][0]).parent / written))
        if any(path == open_path for open_path, _ in chain):
            self.faults.append(_cycle(path, span, chain))
            return None
        self._included += 1
        if self._included > _MOST_INCLUDED:
            if self._included == _MOST_INCLUDED + 1:
                self.faults.append(_too_many(written, span))
            return None
        loaded = self._load(path)
        self.faults += loaded.diagnostics
        if loaded.unreadable is not None:
            message = f"included file `{written}` cannot be read: {loaded.unreadable}"
            self.faults.append(found("OBK008", message, span, help=f"looked for `{path}`"))
        tree = loaded.tree
        if tree is None or (isinstance(tree, TreeScalar) and tree.value is None):
            return None
        if not isinstance(tree, TreeMap):
            message = f"included file `{written}` holds {kind_of(tree)}, expected a mapping"
            there = Related(message="the file starts here", span=tree.span)
            self.faults.append(found("OBK010", message, span, related=(there,)))
            return None
        return self.resolve(tree, (*chain, (path, span)))


def _too_many(written: str, span: Span) -> Diagnostic:
    message = f"over {_MOST_INCLUDED} files are included; `{written}` and all further ones are not"
    return found("OBK007", message, span, help="a file counts each time that it is included")


def _cycle(path: str, span: Span, chain: Chain) -> Diagnostic:
    names = [name for name, _ in chain]
    circle = chain[names.index(path) :]
    shown = " -> ".join((*(name for name, _ in circle), path))
    related = (Related(message=f"`{name}` is included here", span=s) for name, s in circle[1:])
    return found("OBK009", f"files include each other: {shown}", span, related=related)


def _normal(path: str) -> str:
    """The path with `a/../b` and `./` taken out, by its text alone."""
    parts: list[str] = []
    for part in PurePath(path).parts:
        if part == ".." and parts and parts[-1] not in ("..", "/"):
            parts.pop()
        else:
            parts.append(part)
    return str(PurePath(*parts)) if parts else path
