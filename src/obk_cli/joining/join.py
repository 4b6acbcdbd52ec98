"""A new node put into a config: chosen, written, and proved by compiling again.

A config's source, a newcomer and the compiler's options in; the new text and what was wired to what
out, or why not. Writes no file. The text is only returned if it says what it said before and the
new node, and has no error that it did not have.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from obk_cli.compiler import Options, Outcome, compile_source
from obk_cli.config.model import Node, Stack
from obk_cli.config.tree import TreeMap
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, apply_edits
from obk_cli.diagnostics.source import SourceFile
from obk_cli.joining.choose import Link
from obk_cli.joining.entry_text import named_as
from obk_cli.joining.foreseen import ForeseenSurroundings
from obk_cli.joining.insert import insert_node, replace_node
from obk_cli.joining.newcomer import Newcomer
from obk_cli.joining.notes import moved, notes_of
from obk_cli.joining.place import Place, index_of, place_of
from obk_cli.joining.proof import expected_text, new_errors, said_by
from obk_cli.joining.refusal import Refused
from obk_cli.joining.target import choose_device, find_double, find_replaced
from obk_cli.joining.wire import Tick, Wired, wire_newcomer
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["Joined", "join_node"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """A config with a node more, or with one in the place of another."""

    source: SourceFile
    """The text as it was."""
    text: str
    node_name: str
    """The node's full name in the ROS graph."""
    links: tuple[Link, ...]
    ticks: tuple[Tick, ...]
    notes: tuple[str, ...]
    """What else has changed, or should be known, as sentences."""
    before: tuple[Diagnostic, ...]
    """The findings of the config as it was."""


def join_node(
    source: SourceFile,
    newcomer: Newcomer,
    options: Options,
    *,
    device: str | None = None,
    replaces: str | None = None,
) -> Joined | Refused:
    """Put a node into the text of a config.

    `device` chooses among several; `replaces` names a node of the section that makes room. The
    node's package need not be there yet.
    """
    options = _foreseeing(source, newcomer, options)
    before = compile_source(source, options)
    faults = tuple(_unreadable(before))
    tree = parse_source(source).tree
    if faults or before.config is None or not isinstance(tree, TreeMap):
        return Refused(
            sentence=f"`{source.path}` cannot be read as a config, so no node is added",
            help="mend what is told above, then add the node",
            findings=faults or before.diagnostics,
        )
    return _Join(source, tree, newcomer, before, before.config, options).join(device, replaces)


class _Join:
    def __init__(
        self,
        source: SourceFile,
        tree: TreeMap,
        newcomer: Newcomer,
        before: Outcome,
        stack: Stack,
        options: Options,
    ) -> None:
        self._source = source
        self._tree = tree
        self._newcomer = newcomer
        self._before = before
        self._stack = stack
        self._options = options

    def join(self, device: str | None, replaces: str | None) -> Joined | Refused:
        section = self._newcomer.section
        old = find_replaced(self._stack, section, replaces) if replaces else None
        if isinstance(old, Refused):
            return old
        if (double := find_double(self._stack, self._newcomer, old)) is not None:
            return double
        wanted = device or (old.device if old else None)
        chosen = choose_device(self._tree, self._stack, wanted)
        if isinstance(chosen, Refused):
            return chosen
        if old is not None and chosen != old.device:
            return Refused(
                sentence=f"`{old.full_name}` runs on `{old.device}`, not on `{chosen}`",
                help="the new node takes its place: leave the device out",
            )
        wired = wire_newcomer(self._newcomer, self._stack, old)
        if isinstance(wired, Refused):
            return wired
        place = place_of(self._tree, self._stack, section, chosen)
        entry = named_as(place.style, wired.entry)
        index = index_of(place, old) if old else None
        if isinstance(index, Refused):
            return index
        edits = insert_node(place, entry) if index is None else replace_node(place, index, entry)
        if isinstance(edits, Refused):
            return edits
        return self._prove(edits, place, entry, index, wired, old)

    def _prove(
        self,
        edits: tuple[Edit, ...],
        place: Place,
        entry: Mapping[str, object],
        index: int | None,
        wired: Wired,
        old: Node | None,
    ) -> Joined | Refused:
        try:
            text = apply_edits(self._source, edits)
        except ValueError:
            text = ""
        source = SourceFile.of(self._source.path, text)
        tree = parse_source(source).tree
        is_same = tree is not None and said_by(tree, place) == expected_text(
            self._tree, place, entry, index
        )
        if not is_same:
            return self._tied(place)
        after = compile_source(source, self._options)
        errors = new_errors(self._before.diagnostics, after.diagnostics)
        if errors:
            return Refused(
                sentence=f"with the new node `{self._source.path}` would have errors that it "
                "does not have now",
                help="see the errors above; choose other message types, or mend the config first",
                findings=errors,
            )
        node = self._newest(after.config, old)
        if node is None:
            return self._tied(place)
        assert after.config is not None  # it has the node
        return Joined(
            source=self._source,
            text=text,
            node_name=node.full_name,
            links=tuple(moved(link, source, edits) for link in wired.links),
            ticks=wired.ticks,
            notes=notes_of(place, edits, self._stack, after.config, node, old),
            before=self._before.diagnostics,
        )

    def _newest(self, after: Stack | None, old: Node | None) -> Node | None:
        """The new node, if it is all that the stack has more than before."""
        more = 0 if old else 1
        if after is None or len(after.nodes) != len(self._stack.nodes) + more:
            return None
        new = (self._newcomer.pkg, self._newcomer.executable)
        nodes = [
            node
            for node in after.section(self._newcomer.section)
            if node.pkg and node.executable and (node.pkg.value, node.executable.value) == new
        ]
        return nodes[0] if len(nodes) == 1 else None

    def _tied(self, place: Place) -> Refused:
        where = place.entry.key_span if place.entry else self._tree.span
        return Refused(
            sentence=f"the text of section `{place.section}` ({where}) is tied to other places by "
            "anchors, an include or its layout, so a node cannot be added for certain",
            help="write the section out as a list of nodes in the config that is named, "
            "one key on each line, then add the node",
        )


def _foreseeing(source: SourceFile, newcomer: Newcomer, options: Options) -> Options:
    there = options.environment
    if there is None:
        folder = (options.working_folder / Path(source.path)).resolve().parent
        there = MachineEnvironment(folder, options.working_folder, options.variables)
    foreseen = ForeseenSurroundings(there, newcomer.pkg, newcomer.executable)
    return replace(options, environment=foreseen)


def _unreadable(outcome: Outcome) -> Iterator[Diagnostic]:
    """The faults after which it is not known what the config holds."""
    for finding in outcome.diagnostics:
        is_lost = finding.code.startswith("OBK0") or finding.code in ("OBK112", "OBK114")
        if finding.severity == "error" and is_lost:
            yield finding
