"""Parse text into a tree with locations. Any text gives a tree, findings, or both.

The parser is built on PyYAML's event stream. Scalars follow the YAML 1.2 core schema, only the safe
subset is accepted, and the expansion of aliases is limited. It does not open files.
"""

import codecs
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn

import yaml
from yaml.events import AliasEvent, MappingStartEvent, ScalarEvent

from obelisk_spec.yaml_core import MOST_VALUES, REFERENCE, Scalar, core_scalar
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, plain_value
from obk_cli.config.yaml_error_context import YAML_LOADER, YamlText, forbidden_character
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES, SourceFile, Span

__all__ = ["decode_source", "parse_source", "too_many_values"]

_DEEPEST = 100

_PREFIX = "tag:yaml.org,2002:"
_CORE_TAGS = {f"{_PREFIX}{name}" for name in ("str", "int", "float", "bool", "null", "map", "seq")}
_TYPES = {"int": (int,), "float": (float, int), "bool": (bool,), "null": (type(None),)}
"""Tag -> types of the plain scalars that it may have."""
_QUOTED_STYLES = ("'", '"', "|", ">")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parsed:
    """The contents of source text; no tree if it is empty or unreadable."""

    tree: Tree | None
    diagnostics: tuple[Diagnostic, ...] = ()
    values: int = 0
    """Number of values, with aliases expanded."""
    is_whole: bool = True
    """Whether every value is in the tree; for a duplicate key, only the first is."""


def decode_source(path: str, data: bytes) -> SourceFile | Diagnostic:
    """The bytes of a file as a source, or why they cannot be decoded."""
    if len(data) > LONGEST_FILE_BYTES:
        start = Span.at(SourceFile.of(path, ""), 1, 1)
        return found("OBK007", "the file is longer than 10 MiB, so it is not read", start)
    try:
        return SourceFile.of(path, data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        # Use the error's own bytes, which do not include a byte order mark.
        before = SourceFile.of(path, error.object[: error.start].decode("utf-8"))
        place = Span.at(before, len(before.lines), len(before.lines[-1]) + 1)
        is_utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        help = "the file looks like UTF-16; save it as UTF-8" if is_utf16 else None
        return found(
            "OBK002", f"byte 0x{error.object[error.start]:02x} is not UTF-8", place, help=help
        )


def too_many_values(place: Span, *, values_before: int = 0) -> Diagnostic:
    """The finding for source text that exceeds the limit on values."""
    together = ", including those of the previous files" if values_before else ""
    return found("OBK006", f"there are more than {MOST_VALUES:,} values{together}", place)


def parse_source(source: SourceFile, *, values_before: int = 0) -> Parsed:
    """The tree of source text with one YAML document.

    `values_before` is the number of values in the config's other files; the limit applies to all
    of them together.
    """
    unreadable = forbidden_character(source)
    if unreadable is not None:
        return Parsed(tree=None, diagnostics=(unreadable,))
    seen = YamlText(source.text)
    composer = _Composer(source, seen, values_before)
    try:
        # Like `yaml.parse`, but without a Python call for each event.
        tree = composer.document(iter(YAML_LOADER(seen.text).get_event, None))
    except yaml.MarkedYAMLError as error:
        from obk_cli.config.yaml_errors import explain_yaml_error  # rarely needed

        fault = explain_yaml_error(error, source)
        if not any(earlier.span.line == fault.span.line for earlier in composer.faults):
            composer.faults.append(fault)
        tree = None
    except _GivenUpError:
        tree = None
    return Parsed(
        tree=tree,
        diagnostics=tuple(composer.faults),
        values=composer.values,
        is_whole=composer.is_whole,
    )


class _GivenUpError(Exception):
    """The rest of the text is not worth parsing; the finding is already recorded."""


@dataclass(slots=True)
class _Collection:
    """A list or mapping that is not closed yet."""

    start: yaml.CollectionStartEvent
    items: list[Tree] = field(default_factory=list)
    keys: list[tuple[str, Span]] = field(default_factory=list)
    weight: int = 1


@dataclass(slots=True)
class _Anchored:
    tree: Tree
    weight: int


class _Composer:
    """Turns one event stream into one tree; keeps its own stack instead of recursing."""

    def __init__(self, source: SourceFile, seen: YamlText, values_before: int) -> None:
        self.faults: list[Diagnostic] = []
        self.values = 0
        self.is_whole = True
        self._source = source
        self._seen = seen
        self._anchors: dict[str, _Anchored | None] = {}
        self._open: list[_Collection] = []
        self._values_before = values_before

    def document(self, events: Iterator[yaml.Event]) -> Tree | None:
        """The tree of the first document; a second one is a finding."""
        tree: Tree | None = None
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    message = (
                        "a second document starts here, but a config must be a single document"
                    )
                    self._give_up("OBK003", message, event)
            done = self._take(event)
            tree = done or tree
        return tree

    def _take(self, event: yaml.Event) -> Tree | None:
        match event:
            case ScalarEvent():
                return self._add(self._scalar(event), 1, event)
            case AliasEvent():
                anchored = self._aliased(event)
                return self._add(anchored.tree, anchored.weight, event)
            case yaml.CollectionStartEvent():
                self._check_tag(event)
                if len(self._open) >= _DEEPEST:
                    self._give_up(
                        "OBK013", f"values are nested more than {_DEEPEST} levels deep", event
                    )
                if event.anchor:
                    self._anchors[event.anchor] = None
                self._open.append(_Collection(event))
            case yaml.CollectionEndEvent():
                collection = self._open.pop()
                return self._add(
                    self._closed(collection, event), collection.weight, collection.start
                )
        return None

    def _add(self, tree: Tree, weight: int, event: yaml.NodeEvent) -> Tree | None:
        """Add a finished value to its parent; return it if it is the whole document."""
        if event.anchor and not isinstance(event, AliasEvent):
            self._anchors[event.anchor] = _Anchored(tree, weight)
        if not self._open:
            return tree
        parent = self._open[-1]
        parent.weight += weight
        is_map = isinstance(parent.start, MappingStartEvent)
        if is_map and len(parent.keys) == len(parent.items):
            parent.keys.append((self._key(tree), tree.span))
        else:
            parent.items.append(tree)
            self._count(1, event)
        return None

    def _count(self, values: int, event: yaml.NodeEvent) -> None:
        self.values += values
        if self._values_before + self.values > MOST_VALUES:
            place = self._span(event, event)
            self.faults.append(too_many_values(place, values_before=self._values_before))
            raise _GivenUpError

    def _scalar(self, event: ScalarEvent) -> TreeScalar:
        if event.tag:
            self._check_tag(event)
        span = self._span(event, event)
        value = self._seen.restored(event.value)
        if "\0" in value:
            message = "text with the character U+0000 is valid neither in ROS nor in a path"
            self.faults.append(found("OBK003", message, span))
            value = value.replace("\0", "")
        return TreeScalar(self._typed(value, event, span), span)

    def _typed(self, text: str, event: ScalarEvent, span: Span) -> Scalar:
        """The value of the type that a tag names, otherwise of the type that YAML infers."""
        tag = (event.tag or "").removeprefix(_PREFIX)
        if tag not in _TYPES:
            return text if tag == "str" or event.style in _QUOTED_STYLES else core_scalar(text)
        if REFERENCE.search(text):  # the loader replaces it
            return text
        value = core_scalar(text)
        if type(value) not in _TYPES[tag]:
            shown = f"`{text}`" if text else "an empty value"
            self.faults.append(found("OBK005", f"{shown} does not fit the tag `!!{tag}`", span))
        # `float(value)` would raise for a number that is too large.
        return float(str(value)) if tag == "float" and type(value) is int else value

    def _key(self, tree: Tree) -> str:
        """The text of a key; a number or `true` is kept as it is spelled."""
        if isinstance(tree, TreeScalar):
            key = tree.value if isinstance(tree.value, str) else tree.span.text
            if not key:
                self.faults.append(found("OBK003", "a key is empty", tree.span))
            return key
        from obk_cli.config.yaml_errors import template_braces

        braces = template_braces(tree.span) if isinstance(tree, TreeMap) else None
        self.faults.append(
            braces or found("OBK003", "a list or mapping cannot be a key", tree.span)
        )
        return ""

    def _closed(self, collection: _Collection, end: yaml.Event) -> Tree:
        span = self._span(collection.start, end)
        if isinstance(collection.start, yaml.SequenceStartEvent):
            return TreeList(tuple(collection.items), span)
        entries: dict[str, Entry] = {}
        merged: list[Entry] = []
        for (key, key_span), value in zip(collection.keys, collection.items, strict=True):
            if key == "<<" and key_span.text == "<<":
                merged += self._merged(value)
            elif not key:
                self.is_whole = False
            elif key in entries:
                self._duplicate(entries[key], key_span, value)
            else:
                entries[key] = Entry(key, key_span, value)
        for entry in merged:
            entries.setdefault(entry.key, entry)
        return TreeMap(tuple(entries.values()), span)

    def _merged(self, value: Tree) -> list[Entry]:
        """The entries merged by `<<: value`, those of earlier mappings first."""
        sources = value.items if isinstance(value, TreeList) else (value,)
        entries: list[Entry] = []
        for source in sources:
            if isinstance(source, TreeMap):
                entries += source.entries
            else:
                message = "`<<` merges mappings, but this is not a mapping"
                self.faults.append(found("OBK003", message, source.span))
        return entries

    def _duplicate(self, first: Entry, second: Span, value: Tree) -> None:
        is_scalar = isinstance(value, TreeScalar) and isinstance(first.value, TreeScalar)
        if not is_scalar or plain_value(value) != plain_value(first.value):
            self.is_whole = False
        are_lists = isinstance(first.value, TreeList) and isinstance(value, TreeList)
        help = f"put the items of both under one `{first.key}`" if are_lists else None
        self.faults.append(
            found(
                "OBK004",
                f"duplicate key `{first.key}` in this mapping",
                second,
                help=help,
                related=(Related(message="first used here", span=first.key_span),),
            )
        )

    def _aliased(self, event: AliasEvent) -> _Anchored:
        anchored = self._anchors.get(event.anchor or "")
        if anchored is None:
            inside = event.anchor in self._anchors
            why = "refers to itself" if inside else "refers to an undefined anchor"
            help = f'put text that starts with `*` in quotes: `"*{event.anchor}"`'
            self._give_up("OBK003", f"alias `*{event.anchor}` {why}", event, help)
        self._count(anchored.weight, event)
        return anchored

    def _check_tag(self, event: ScalarEvent | yaml.CollectionStartEvent) -> None:
        if event.tag and event.tag not in _CORE_TAGS and event.tag != "!":
            tag = event.tag.replace(_PREFIX, "!!")
            span = self._span(event, event)
            message = f"tag `{tag}` is not allowed, because a config contains only plain values"
            help = None if tag.startswith("!!") else "put text that starts with `!` in quotes"
            self.faults.append(found("OBK005", message, span, help=help))

    def _give_up(
        self, code: str, message: str, event: yaml.Event, help: str | None = None
    ) -> NoReturn:
        self.faults.append(found(code, message, self._span(event, event), help=help))
        raise _GivenUpError

    def _span(self, first: yaml.Event, last: yaml.Event) -> Span:
        start, end = first.start_mark, last.end_mark
        assert start is not None  # only synthetic events have no marks
        assert end is not None
        return Span(self._source, start.line + 1, start.column + 1, end.line + 1, end.column + 1)
