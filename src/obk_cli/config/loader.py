"""Load a config and everything that it includes into one tree in which each value has a location.

The loader reads each file once, replaces variables, merges includes, and applies `--set`.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

from obelisk_spec.components import component_identity
from obelisk_spec.suggestions import ask_for, did_you_mean, near_names
from obelisk_spec.yaml_core import MOST_VALUES, REFERENCE, Scalar, core_scalar, value_of_reference
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of
from obk_cli.config.yaml_parser import decode_source, parse_source, too_many_values
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import COMMAND_LINE, LONGEST_FILE_BYTES, SourceFile, Span
from obk_cli.files import STANDARD_INPUT

__all__ = ["ConfigFiles", "apply_overrides", "load_config", "merge_trees", "resolve_variables"]

Identity = tuple[str, str]

_IDENTITY_KEYS = ("name", "id", "key", "ros_parameter", "topic")
_COMPONENT_KEYS = ("key", "ros_parameter")


_STEP = re.compile(r"(?:^|\.)([A-Za-z_][\w-]*)|\[([0-9]{1,9})\]")
_MOST_STEPS = 100


def merge_trees(inner: Tree, outer: Tree) -> Tree:
    """Merge `outer` over `inner`: mappings by key, lists of mappings by identity."""
    match inner, outer:
        case TreeMap(), TreeMap():
            return _merge_maps(inner, outer)
        case ((TreeList() | TreeMap()), (TreeList() | TreeMap())):
            inner_items, outer_items = _as_maps(inner), _as_maps(outer)
            # An empty list replaces the inner one.
            if inner_items is not None and outer_items:
                return TreeList(_merge_items(inner_items, outer_items), outer.span)
    return outer


def _merge_maps(inner: TreeMap, outer: TreeMap) -> TreeMap:
    over = {entry.key: entry for entry in outer}
    merged = [_merge_entry(entry, over.pop(entry.key, None)) for entry in inner]
    kept = [entry for entry in merged if entry is not None]
    return TreeMap((*kept, *over.values()), outer.span)


def _merge_entry(inner: Entry, outer: Entry | None) -> Entry | None:
    """The merged entry; None if the outer file removes the key by setting it to null."""
    if outer is None:
        return inner
    if isinstance(outer.value, TreeScalar) and outer.value.value is None:
        return None
    return Entry(outer.key, outer.key_span, merge_trees(inner.value, outer.value))


def _as_maps(tree: TreeList | TreeMap) -> tuple[TreeMap, ...] | None:
    """The mappings of a list; a single mapping counts as a list of one; None for other lists."""
    items = (tree,) if isinstance(tree, TreeMap) else tree.items
    maps = tuple(item for item in items if isinstance(item, TreeMap))
    return maps if len(maps) == len(items) else None


def _merge_items(inner: tuple[TreeMap, ...], outer: tuple[TreeMap, ...]) -> tuple[TreeMap, ...]:
    merged = list(inner)
    places = {_identity(item): index for index, item in enumerate(inner)}
    for item in outer:
        identity = _identity(item)
        index = None if identity is None else places.get(identity)
        if index is None:
            merged.append(item)
        else:
            merged[index] = _merge_maps(merged[index], item)
    return tuple(merged)


def _identity(item: TreeMap) -> Identity | None:
    """The identity of an item: its first naming key and that key's value."""
    for key in _IDENTITY_KEYS:
        entry = item.get(key)
        if entry is None or not isinstance(entry.value, TreeScalar) or entry.value.value is None:
            continue
        text = str(entry.value.value)
        return ("component", component_identity(text)) if key in _COMPONENT_KEYS else (key, text)
    return None


class _UnfitError(Exception):
    """A path that does not fit the config; its help lists what exists."""

    def __init__(self, message: str, help: str | None = None) -> None:
        super().__init__(message)
        self.help = help


def apply_overrides(
    tree: TreeMap, options: Iterable[str]
) -> tuple[TreeMap, tuple[Diagnostic, ...]]:
    """Apply each option in turn; the location of its value is `<command line>`."""
    faults: list[Diagnostic] = []
    for option in options:
        span = Span.at(SourceFile.of(COMMAND_LINE, option), 1, 1, max(len(option), 1))
        try:
            path, text = _split(option)
            parsed = parse_source(SourceFile.of(COMMAND_LINE, text))
            faults += parsed.diagnostics
            if parsed.tree is not None and not parsed.diagnostics:
                new = _set(tree, path, parsed.tree, span)
                tree = new if isinstance(new, TreeMap) else tree
        except _UnfitError as error:
            faults.append(found("OBK012", f"`--set {option}`: {error}", span, help=error.help))
    return tree, tuple(faults)


def _split(option: str) -> tuple[list[str | int], str]:
    path, equals, text = option.partition("=")
    if not equals:
        raise _UnfitError("`=` is missing", "write it as `path=value`")
    steps: list[str | int] = []
    at = 0
    while at < len(path):
        step = _STEP.match(path, at)
        if step is None or (at == 0 and path.startswith((".", "["))):
            raise _UnfitError(f"`{path}` is not a path", "write it as `robot[0].sim[0].time_step`")
        steps.append(step[1] if step[1] is not None else int(step[2]))
        at = step.end()
    if not steps:
        raise _UnfitError("the path is empty", "write it as `robot[0].sim[0].time_step`")
    if len(steps) > _MOST_STEPS:
        raise _UnfitError(f"the path has {len(steps)} steps, expected at most {_MOST_STEPS}")
    return steps, text or "~"


def _set(tree: Tree | None, path: list[str | int], value: Tree, span: Span) -> Tree:
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return _set_key(tree, step, rest, value, span)
    if isinstance(tree, TreeMap) and step == 0:
        return _set(tree, rest, value, span)
    if not isinstance(tree, TreeList):
        what = "nothing" if tree is None else kind_of(tree)
        raise _UnfitError(f"`[{step}]` needs a list, found {what}")
    if step >= len(tree.items):
        count = len(tree.items)
        raise _UnfitError(f"`[{step}]` is out of range, the list has {count} (starting at [0])")
    items = list(tree.items)
    items[step] = _set(items[step], rest, value, span)
    return TreeList(tuple(items), tree.span)


def _set_key(
    tree: Tree | None, key: str, rest: list[str | int], value: Tree, span: Span
) -> TreeMap:
    if tree is None:
        tree = TreeMap((), span)
    if isinstance(tree, TreeList):
        raise _UnfitError(
            f"`{key}` needs a mapping, but its parent is a list",
            f"select an item of the list, such as `[0].{key}`",
        )
    if not isinstance(tree, TreeMap):
        raise _UnfitError(f"`{key}` needs a mapping, found {kind_of(tree)}")
    old = tree.get(key)
    if old is None and rest and isinstance(rest[0], int):
        known = [entry.key for entry in tree]
        raise _UnfitError(f"unknown key `{key}`", did_you_mean(key, known))
    new = Entry(key, span, _set(old.value if old else None, rest, value, span))
    if old is None:
        return TreeMap((*tree.entries, new), tree.span)
    return TreeMap(tuple(new if entry.key == key else entry for entry in tree), tree.span)


_MOST_SUGGESTIONS = 50
"""Maximum number of findings that suggest a similar name."""


def resolve_variables(
    tree: Tree, environment: Mapping[str, str]
) -> tuple[Tree, tuple[Diagnostic, ...]]:
    """Replace every reference; add a finding for each one without a value.

    An unquoted value is parsed again afterwards, so `${STEP:-0.001}` is a number.
    """
    replacer = _Replacer(environment)
    return replacer.tree(tree), tuple(replacer.faults)


class _Replacer:
    """Replaces references; collects findings and the total length of the text."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.faults: list[Diagnostic] = []
        self._environment = environment
        self._room = LONGEST_FILE_BYTES

    def tree(self, tree: Tree) -> Tree:
        """Replace every reference, up to the size limit."""
        match tree:
            case TreeMap():
                entries = (replace(entry, value=self.tree(entry.value)) for entry in tree)
                return TreeMap(tuple(entries), tree.span)
            case TreeList():
                return TreeList(tuple(map(self.tree, tree.items)), tree.span)
            case TreeScalar(value=str() as text) if "${" in text and self._room >= 0:
                return self._text(text, tree.span)
        return tree

    def _text(self, text: str, span: Span) -> TreeScalar:
        reported: set[str] = set()
        places: dict[str, Span] = {}
        # Aliases repeat text and variables expand to any length, so the total is limited.
        self._room -= len(text)

        def value_of(reference: re.Match[str]) -> str:
            value = value_of_reference(reference, self._environment)
            if value is not None:
                self._room -= len(value)
                return value if self._room >= 0 else ""
            if reference[0] not in reported:
                reported.add(reference[0])
                known = self._environment if len(self.faults) < _MOST_SUGGESTIONS else {}
                places.update({} if places else _first_places(span))
                place = places.get(reference[0], span)
                self.faults.append(_undefined(reference[1], place, known))
            return reference[0]

        new = REFERENCE.sub(value_of, text)
        if self._room < 0:
            message = "the expanded environment variables exceed 10 MiB in total"
            self.faults.append(found("OBK007", message, span))
            return TreeScalar(text, span)
        return TreeScalar(_typed(new, span.text), span, new)


_PROPERTIES = re.compile(r"(?:[&!]\S*\s+)*")
"""The anchor and the tag before a value."""


def _typed(text: str, written: str) -> Scalar:
    """The value of a text that variables gave, by the tag and the quotes of the written value."""
    properties = _PROPERTIES.match(written)
    tags = properties[0].split() if properties else []
    is_quoted = written[len(" ".join(tags)) :].lstrip()[:1] in ("'", '"', "|", ">")
    if "!!str" in tags or (is_quoted and not any(tag.startswith("!!") for tag in tags)):
        return text
    value = core_scalar(text)
    return float(value) if "!!float" in tags and type(value) is int else value


def _first_places(span: Span) -> dict[str, Span]:
    """Reference -> its first location on the first line of a value."""
    places: dict[str, Span] = {}
    for match in REFERENCE.finditer(span.text):
        column = span.column + match.start()
        places.setdefault(match[0], Span.at(span.source, span.line, column, len(match[0])))
    return places


def _undefined(name: str | None, place: Span, environment: Mapping[str, str]) -> Diagnostic:
    if name is None:
        message = "`${` does not start a `${NAME}`"
        return found("OBK011", message, place, help="write `$${` for a literal `${`")
    hint = ask_for(near_names(name, environment))
    default = f"provide a default with `${{{name}:-text}}`"
    return found(
        "OBK011",
        f"environment variable `{name}` is not set",
        place,
        help=f"{hint} or {default}" if hint else default,
    )


_MOST_INCLUDED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedFile:
    """The content of a file; `unreadable` is the reason if it cannot be opened."""

    tree: Tree | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    unreadable: str | None = None


class ConfigFiles:
    """The files of one config: each is read once, and limits apply to their total.

    Args:
        source: the config itself.
        variables: values for `${NAME}`.
        working_folder: findings show paths relative to it.
        read: returns a file's content, or why it cannot be read.
        similar: returns existing paths similar to that of a missing file.
    """

    def __init__(
        self,
        source: SourceFile,
        *,
        variables: Mapping[str, str],
        working_folder: Path,
        read: Callable[[str], bytes | str],
        similar: Callable[[str], Sequence[str]] = lambda _: (),
    ) -> None:
        self.sources = [source]
        self.similar = similar
        self.are_whole = True
        """Whether the trees contain everything in the files."""
        self._variables = variables
        self._working_folder = working_folder
        self._read = read
        self._bytes = len(source.text.encode("utf-8", "surrogatepass"))
        self._values = 0
        self._loaded: dict[str, tuple[LoadedFile, int]] = {}
        self._limit_exceeded: Diagnostic | None = None

    def parse(self, source: SourceFile) -> tuple[Tree | None, tuple[Diagnostic, ...]]:
        """Parse a file and replace its variables; its values count towards the limit."""
        parsed = parse_source(source, values_before=self._values)
        self._values += parsed.values
        self.are_whole = self.are_whole and parsed.is_whole
        if parsed.tree is None:
            return None, parsed.diagnostics
        if "${" not in source.text:  # most files have no references
            return parsed.tree, parsed.diagnostics
        tree, faults = resolve_variables(parsed.tree, self._variables)
        return tree, parsed.diagnostics + faults

    def whole_path(self, path: str) -> str:
        """The path from the root, which is the same for `a` and `../folder/a`."""
        return _normal(str(self._working_folder / path))

    def load_shown(self, path: Path) -> LoadedFile:
        """Load a file; findings show its path relative to the working folder."""
        is_near = path.is_relative_to(self._working_folder)
        shown = path.relative_to(self._working_folder) if is_near else path
        return self.load(str(path), shown=str(shown))

    def load(self, path: str, *, shown: str | None = None) -> LoadedFile:
        """Load another file; its values count each time it is loaded."""
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
        # Only the config itself may be standard input.
        data = self._read(f"./{path}" if path == STANDARD_INPUT else path)
        if isinstance(data, str):
            return LoadedFile(unreadable=data)
        self._bytes += len(data)
        if self._bytes > LONGEST_FILE_BYTES >= len(data):
            message = "this file and those before it exceed 10 MiB, so it is not read"
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
    """Load a config: merge its includes and apply overrides.

    Args:
        source: the config, the first of `files`.
        files: reads the files that it includes.
        overrides: `path=value`, as for `--set`.

    Returns:
        The tree, None if the text has no values, and the findings in all files.
    """
    tree, faults = files.parse(source)
    if tree is None:
        empty = found("OBK114", "the file is empty", Span.at(source, 1, 1))
        return None, faults or (empty,)
    if not isinstance(tree, TreeMap):
        return tree, faults
    includes = _Includes(files)
    tree = includes.resolve(tree, ((_normal(source.path), tree.span),))
    tree, override_faults = apply_overrides(tree, overrides)
    return tree, (*faults, *includes.faults, *override_faults)


Chain = tuple[tuple[str, Span], ...]
"""The files being included, outermost first, each with the location that includes it."""


class _Includes:
    """Follows `include:` through all files of a config; each file contributes once."""

    def __init__(self, files: ConfigFiles) -> None:
        self.faults: list[Diagnostic] = []
        self._files = files
        self._included: set[str] = set()

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
                message = f"`include` contains {kind_of(item)}, expected paths"
                self.faults.append(found("OBK103", message, item.span))

    def _fragment(self, written: str, span: Span, chain: Chain) -> TreeMap | None:
        path = _normal(str(PurePath(chain[-1][0]).parent / written))
        whole = self._files.whole_path(path)
        for open_path, _ in chain:
            if whole == self._files.whole_path(open_path):
                self.faults.append(_cycle(open_path, span, chain))
                return None
        if whole in self._included:
            return None  # its entries without an identity would be there twice
        self._included.add(whole)
        if len(self._included) > _MOST_INCLUDED:
            if len(self._included) == _MOST_INCLUDED + 1:
                self.faults.append(_too_many(written, span))
            return None
        loaded = self._files.load(path)
        self.faults += loaded.diagnostics
        if loaded.unreadable is not None:
            message = f"included file `{written}` cannot be read: {loaded.unreadable}"
            hint = self._meant(path, chain) or f"looked for `{path}`"
            self.faults.append(found("OBK008", message, span, help=hint))
        tree = loaded.tree
        if tree is None or (isinstance(tree, TreeScalar) and tree.value is None):
            return None
        if not isinstance(tree, TreeMap):
            message = f"included file `{written}` contains {kind_of(tree)}, expected a mapping"
            there = Related(message="the file starts here", span=tree.span)
            self.faults.append(found("OBK010", message, span, related=(there,)))
            return None
        return self.resolve(tree, (*chain, (path, span)))

    def _meant(self, path: str, chain: Chain) -> str | None:
        """Suggest similar paths, relative to the including file."""
        open_paths = {self._files.whole_path(open_path) for open_path, _ in chain}
        near = [p for p in self._files.similar(path) if self._files.whole_path(p) not in open_paths]
        folder = PurePath(chain[-1][0]).parent
        return ask_for(os.path.relpath(one, folder) for one in near)


def _too_many(written: str, span: Span) -> Diagnostic:
    message = (
        f"more than {_MOST_INCLUDED} files are included; `{written}` and all later ones are ignored"
    )
    return found("OBK007", message, span)


def _cycle(path: str, span: Span, chain: Chain) -> Diagnostic:
    names = [name for name, _ in chain]
    circle = chain[names.index(path) :]
    shown = " -> ".join((*(name for name, _ in circle), path))
    related = (Related(message=f"`{name}` is included here", span=s) for name, s in circle[1:])
    return found("OBK009", f"files include each other: {shown}", span, related=related)


def _normal(path: str) -> str:
    """Remove `a/../b` and `./` from a path, without looking at the file system."""
    parts: list[str] = []
    for part in PurePath(path).parts:
        if part == ".." and parts and parts[-1] not in ("..", "/"):
            parts.pop()
        else:
            parts.append(part)
    return str(PurePath(*parts)) if parts else path
