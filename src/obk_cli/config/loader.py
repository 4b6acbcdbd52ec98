"""A config's text and everything that it includes -> one tree, in which each value has its place.

Reads each file once, replaces variables, merges includes, and applies `--set`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

from obk_cli.config.merge import apply_overrides, merge_trees
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.config.variables import resolve_variables
from obk_cli.config.yaml_parser import MOST_VALUES, decode_source, parse_source, too_many_values
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES, SourceFile, Span
from obk_cli.files import STANDARD_INPUT

__all__ = ["ConfigFiles", "LoadedFile", "load_config"]

_MOST_INCLUDED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFile:
    """What a file held; `unreadable` says why it could not be opened."""

    tree: Tree | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    unreadable: str | None = None


class ConfigFiles:
    """The files of one config: each is read once, and limits apply to all of them together.

    Args:
        source: the config itself.
        variables: stands in for `${NAME}`.
        working_folder: findings show paths relative to it.
        read: returns what a file holds, or why it cannot be read.
    """

    def __init__(
        self,
        source: SourceFile,
        *,
        variables: Mapping[str, str],
        working_folder: Path,
        read: Callable[[str], bytes | str],
    ) -> None:
        self.sources = [source]
        self.are_whole = True
        """Whether the trees hold everything that the files say."""
        self._variables = variables
        self._working_folder = working_folder
        self._read = read
        self._bytes = len(source.text.encode("utf-8", "surrogatepass"))
        self._values = 0
        self._loaded: dict[str, tuple[LoadedFile, int]] = {}
        self._limit_exceeded: Diagnostic | None = None

    def parse(self, source: SourceFile) -> tuple[Tree | None, tuple[Diagnostic, ...]]:
        """The tree of a file with its variables replaced; its values count towards the limit."""
        parsed = parse_source(source, values_before=self._values)
        self._values += parsed.values
        self.are_whole = self.are_whole and parsed.is_whole
        if parsed.tree is None:
            return None, parsed.diagnostics
        if "${" not in source.text:  # most files need no such walk
            return parsed.tree, parsed.diagnostics
        tree, faults = resolve_variables(parsed.tree, self._variables)
        return tree, parsed.diagnostics + faults

    def load_shown(self, path: Path) -> LoadedFile:
        """Load a file; findings show its path as a user in the working folder would write it."""
        is_near = path.is_relative_to(self._working_folder)
        shown = path.relative_to(self._working_folder) if is_near else path
        return self.load(str(path), shown=str(shown))

    def load(self, path: str, *, shown: str | None = None) -> LoadedFile:
        """What a further file holds; its values count each time that it is loaded."""
        if self._limit_exceeded is not None:
            return LoadedFile(diagnostics=(self._limit_exceeded,))
        start = Span.at(SourceFile.of(shown or path, ""), 1, 1)
        before = self._values
        if path in self._loaded:
            loaded, values = self._loaded[path]
            self._values += values
            if self._values > MOST_VALUES:
                self._limit_exceeded = too_many_values(start, values_before=before)
        else:
            loaded = self._load(path, start)
            self._loaded[path] = (loaded, self._values - before)
        if self._limit_exceeded is not None:
            return LoadedFile(diagnostics=(self._limit_exceeded,))
        return loaded

    def _load(self, path: str, start: Span) -> LoadedFile:
        # Only the config itself may be the standard input.
        data = self._read(f"./{path}" if path == STANDARD_INPUT else path)
        if isinstance(data, str):
            return LoadedFile(unreadable=data)
        self._bytes += len(data)
        if self._bytes > LONGEST_FILE_BYTES >= len(data):
            message = "this file and those before it are longer than 10 MiB, so it is not read"
            self._limit_exceeded = found("OBK007", message, start)
            return LoadedFile()
        source = decode_source(start.path, data)
        if isinstance(source, Diagnostic):
            return LoadedFile(diagnostics=(source,))
        self.sources.append(source)
        tree, faults = self.parse(source)
        self._limit_exceeded = next((fault for fault in faults if fault.code == "OBK006"), None)
        return LoadedFile(tree=tree, diagnostics=faults)


def load_config(
    source: SourceFile, files: ConfigFiles, overrides: Iterable[str]
) -> tuple[Tree | None, tuple[Diagnostic, ...]]:
    """The tree of a config, with its includes merged under it and `path=value` applied to it.

    Args:
        source: the config, the first of `files`.
        files: reads the files that it includes.
        overrides: `path=value`, as `--set` takes them.

    Returns:
        The tree, None if the text holds no value, and findings about all files.
    """
    tree, faults = files.parse(source)
    if tree is None:
        empty = found("OBK114", "the file is empty, not a config", Span.at(source, 1, 1))
        return None, faults or (empty,)
    if not isinstance(tree, TreeMap):
        return tree, faults
    includes = _Includes(files)
    tree = includes.resolve(tree, ((_normal(source.path), tree.span),))
    tree, override_faults = apply_overrides(tree, overrides)
    return tree, (*faults, *includes.faults, *override_faults)


Chain = tuple[tuple[str, Span], ...]
"""The files that are open, outermost first, each with the place that named it."""


class _Includes:
    """`include:` followed through all files of a config."""

    def __init__(self, files: ConfigFiles) -> None:
        self.faults: list[Diagnostic] = []
        self._files = files
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
        loaded = self._files.load(path)
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
