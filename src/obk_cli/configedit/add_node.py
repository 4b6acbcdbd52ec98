"""Add a node to a config: wire it, edit the text, and verify the result by compiling it.

The result is the new text and the wiring, or why the node cannot be added; nothing is written
here. The new text has the old content and the new node, and no new errors.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from obelisk_spec.suggestions import did_you_mean, list_names
from obk_cli.compiler import Options, Outcome, compile_source
from obk_cli.config.environment import (
    CodeFault,
    Command,
    Environment,
    ExecutableMissing,
    ModelFault,
    ModelRead,
    NodeCode,
    PolicyFault,
    PolicyRead,
    ReplacedMessages,
)
from obk_cli.config.model import ONE_DEVICE, Node, Stack
from obk_cli.config.tree import Tree, TreeMap, plain_value
from obk_cli.config.yaml_parser import parse_source
from obk_cli.configedit.auto_wiring import Wired, wire_node
from obk_cli.configedit.block_editor import (
    InsertionPoint,
    index_of,
    insert_node,
    named_as,
    place_of,
    replace_node,
    snippet_of,
)
from obk_cli.configedit.new_node import NewNode, Rejected
from obk_cli.configedit.report import AddedNode, lost_publishers, moved, notes_of
from obk_cli.configedit.spelling import devices_of
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["add_node", "find_replaced", "new_errors"]


@dataclass(frozen=True, slots=True)
class PlannedEnvironment:
    """The current environment with one additional executable, whose code is unknown."""

    current: Environment
    package: str
    executable: str

    def find_package_share(self, name: str) -> Path | None:
        """The folder that holds a package's data."""
        return self.current.find_package_share(name)

    def manifest_fault(self, package: str) -> CodeFault | None:
        """Why the package.xml of a package cannot be read."""
        return self.current.manifest_fault(package)

    def package_names(self) -> tuple[str, ...]:
        """All packages, including the new one."""
        return tuple(sorted({*self.current.package_names(), self.package}))

    def message_packages(self) -> tuple[str, ...]:
        """The packages of the workspace that define messages."""
        return self.current.message_packages()

    def message_names(self, package: str) -> tuple[str, ...] | None:
        """The messages that a package defines."""
        return self.current.message_names(package)

    def replaced_messages(self) -> tuple[ReplacedMessages, ...]:
        """The workspace packages that replace one of Obelisk's and lack messages or fields."""
        return self.current.replaced_messages()

    def find_executable(self, package: str, executable: str) -> Command | ExecutableMissing:
        """How to start an executable."""
        if (package, executable) == (self.package, self.executable):
            return Command(arguments=())
        return self.current.find_executable(package, executable)

    def read_node_code(self, package: str, executable: str) -> NodeCode | None:
        """What the Python source of an executable defines."""
        if (package, executable) == (self.package, self.executable):
            return None
        return self.current.read_node_code(package, executable)

    def read_hazards(self, package: str, executable: str) -> tuple[Diagnostic, ...]:
        """Code of an executable that may behave differently between two lockstep runs."""
        if (package, executable) == (self.package, self.executable):
            return ()
        return self.current.read_hazards(package, executable)

    def is_cpp(self, package: str, executable: str) -> bool:
        """Whether an executable is in C++."""
        if (package, executable) == (self.package, self.executable):
            return False
        return self.current.is_cpp(package, executable)

    def read_model(self, path: Path) -> ModelRead | ModelFault | None:
        """Facts about a model."""
        return self.current.read_model(path)

    def read_policy(self, path: Path) -> PolicyRead | PolicyFault | None:
        """The input and output sizes of a network."""
        return self.current.read_policy(path)

    def model_line(self, path: Path, line: int) -> Span:
        """A whole line of a model file."""
        return self.current.model_line(path, line)

    def model_element(self, path: Path, kind: str, name: str) -> Span | None:
        """The location where a model defines an element."""
        return self.current.model_element(path, kind, name)


def new_errors(before: Iterable[Diagnostic], after: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Errors that occur more often than before, ignoring line numbers and numbered names."""
    old = [finding for finding in before if finding.severity == "error"]
    known = {(finding.code, finding.message) for finding in old}
    errors = [finding for finding in after if finding.severity == "error"]
    more = Counter(f.code for f in errors) - Counter(f.code for f in old)
    return tuple(f for f in errors if f.code in more and (f.code, f.message) not in known)


def expected_content(
    tree: TreeMap, place: InsertionPoint, entry: Mapping[str, object], index: int | None
) -> object:
    """The expected content: that of `tree`, with the node last or at `index`."""
    plain = plain_value(tree)
    holder = _holder(plain, place)
    nodes = _nodes(holder.get(place.section))
    if index is None:
        nodes.append(dict(entry))
    else:
        nodes[index] = dict(entry)
    holder[place.section] = nodes
    return plain


def content_of(tree: Tree, place: InsertionPoint) -> object:
    """The contents of source text, with the section at the insertion point as a list."""
    plain = plain_value(tree)
    holder = _holder(plain, place)
    holder[place.section] = _nodes(holder.get(place.section))
    return plain


def _holder(plain: object, place: InsertionPoint) -> dict[str, object]:
    assert isinstance(plain, dict)  # a config is a mapping
    key = place.device.key if place.device else place.new_device
    holder = plain.setdefault(key, {}) if key else plain
    assert isinstance(holder, dict)
    return holder


def _nodes(value: object) -> list[object]:
    if isinstance(value, list):
        return list(value)
    return [] if value is None else [value]


def add_node(
    source: SourceFile,
    new_node: NewNode,
    options: Options,
    *,
    before: Outcome | None = None,
    device: str | None = None,
    replaces: str | None = None,
) -> AddedNode | Rejected:
    """Insert a node into the text of a config.

    `before` is the compiled config; it is compiled here if not given. `device` selects one of
    several devices; `replaces` names the node to replace in the section. The new node's
    package need not exist yet.
    """
    options = _with_planned(source, new_node, options)
    before = before or compile_source(source, options)
    faults = tuple(_unreadable(before))
    tree = parse_source(source).tree
    if faults or before.config is None or not isinstance(tree, TreeMap):
        return Rejected(
            sentence=f"`{source.path}` cannot be read as a config, so no node was added",
            help="fix the findings above, then add the node",
            findings=faults or before.diagnostics,
        )
    return _Addition(source, tree, new_node, before, before.config, options).run(device, replaces)


class _Addition:
    def __init__(
        self,
        source: SourceFile,
        tree: TreeMap,
        new_node: NewNode,
        before: Outcome,
        stack: Stack,
        options: Options,
    ) -> None:
        self._source = source
        self._tree = tree
        self._node = new_node
        self._before = before
        self._stack = stack
        self._options = options

    def run(self, device: str | None, replaces: str | None) -> AddedNode | Rejected:
        section = self._node.section
        old = find_replaced(self._stack, section, replaces) if replaces else None
        if isinstance(old, Rejected):
            return old
        if (duplicate := _find_duplicate(self._stack, self._node, old)) is not None:
            return duplicate
        requested = device or (old.device if old else None)
        chosen = _choose_device(self._tree, self._stack, requested)
        if isinstance(chosen, Rejected):
            return chosen
        if old is not None and chosen != old.device:
            return Rejected(
                sentence=f"`{old.full_name}` runs on `{old.device}`, not on `{chosen}`",
                help="the new node runs on the same device: omit `--device`",
            )
        wired = wire_node(self._node, self._stack, old)
        if isinstance(wired, Rejected):
            return wired
        place = place_of(self._tree, self._stack, section, chosen)
        entry = named_as(place.style, wired.entry)
        result = self._edit(place, entry, wired, old)
        if isinstance(result, Rejected) and not result.findings:
            return replace(result, snippet=snippet_of(place, entry))
        return result

    def _edit(
        self, place: InsertionPoint, entry: Mapping[str, object], wired: Wired, old: Node | None
    ) -> AddedNode | Rejected:
        index = index_of(place, old) if old else None
        if isinstance(index, Rejected):
            return index
        edits = insert_node(place, entry) if index is None else replace_node(place, index, entry)
        if isinstance(edits, Rejected):
            return edits
        return self._verify(edits, place, entry, index, wired, old)

    def _verify(
        self,
        edits: tuple[Edit, ...],
        place: InsertionPoint,
        entry: Mapping[str, object],
        index: int | None,
        wired: Wired,
        old: Node | None,
    ) -> AddedNode | Rejected:
        try:
            text = apply_edits(self._source, edits)
        except ValueError:
            text = ""
        source = SourceFile.of(self._source.path, text)
        tree = parse_source(source).tree
        is_same = tree is not None and content_of(tree, place) == expected_content(
            self._tree, place, entry, index
        )
        if not is_same:
            return self._tied(place)
        after = compile_source(source, self._options)
        errors = new_errors(self._before.diagnostics, after.diagnostics)
        if errors:
            return Rejected(
                sentence=f"the new node would cause errors in `{self._source.path}` that it "
                "does not have now",
                help="see the errors above; choose other message types, or fix the config first",
                findings=errors,
            )
        node = self._newest(after.config, old)
        if node is None:
            return self._tied(place)
        assert after.config is not None  # it contains the node
        return AddedNode(
            source=self._source,
            text=text,
            node_name=node.full_name,
            links=tuple(moved(link, source, edits) for link in wired.links),
            ticks=wired.ticks,
            notes=notes_of(place, edits, self._stack, after.config, node, old),
            unpublished=lost_publishers(self._stack, after.config),
            before=self._before.diagnostics,
        )

    def _newest(self, after: Stack | None, old: Node | None) -> Node | None:
        """The new node, if it is the only addition to the stack."""
        more = 0 if old else 1
        if after is None or len(after.nodes) != len(self._stack.nodes) + more:
            return None
        new = (self._node.pkg, self._node.executable)
        nodes = [
            node
            for node in after.section(self._node.section)
            if node.pkg and node.executable and (node.pkg.value, node.executable.value) == new
        ]
        return nodes[0] if len(nodes) == 1 else None

    def _tied(self, place: InsertionPoint) -> Rejected:
        where = place.entry.key_span if place.entry else self._tree.span
        return Rejected(
            sentence=f"section `{place.section}` ({where}) cannot be edited because of its "
            "anchors, an include or its layout",
            help="write the section as a block list in the config itself, one key on each line, "
            "then add the node, or paste it there yourself",
        )


def _with_planned(source: SourceFile, new_node: NewNode, options: Options) -> Options:
    current = options.environment
    if current is None:
        folder = (options.working_folder / Path(source.path)).resolve().parent
        current = MachineEnvironment(folder, options.working_folder, options.variables)
    planned = PlannedEnvironment(current, new_node.pkg, new_node.executable)
    return replace(options, environment=planned)


def _unreadable(outcome: Outcome) -> Iterator[Diagnostic]:
    """The faults that make the config's content unknown."""
    for finding in outcome.diagnostics:
        is_lost = finding.code.startswith("OBK0") or finding.code in ("OBK112", "OBK114")
        if finding.severity == "error" and is_lost:
            yield finding


def find_replaced(stack: Stack, section: str, name: str) -> Node | Rejected:
    """The node of a section by its full or short name, or by its executable."""
    nodes = list(stack.section(section))
    exact = [node for node in nodes if name in _names(node)] or [
        node for node in nodes if node.executable and name == node.executable.value
    ]
    if len(exact) == 1:
        return exact[0]
    if exact:
        return Rejected(
            sentence=f"`{name}` matches {len(exact)} nodes of `{section}`",
            help=f"choose one: {list_names(node.node_name for node in exact)}",
        )
    names = [node.node_name for node in nodes]
    return Rejected(
        sentence=f"section `{section}` has no node `{name}` to replace",
        help=did_you_mean(name, names) or "the section is empty: add a node instead",
    )


def _choose_device(tree: TreeMap, stack: Stack, name: str | None) -> str | Rejected:
    """The device with this name; without a name, the only device."""
    here = (entry.key for entry in devices_of(tree))
    known = list(dict.fromkeys((*here, *(node.device for node in stack.nodes)))) or [ONE_DEVICE]
    if name in known:
        return name
    if name is not None:
        help = did_you_mean(name, known) or ""
        return Rejected(sentence=f"the config has no device `{name}`", help=help)
    if len(known) > 1:
        return Rejected(
            sentence=f"the config has {len(known)} devices, so the new node needs one of them",
            help=f"choose one: {list_names(known)}",
        )
    return known[0]


def _find_duplicate(stack: Stack, new_node: NewNode, old: Node | None) -> Rejected | None:
    """Reject a node that is already in the config, unless it is being replaced."""
    for node in stack.section(new_node.section):
        if node is old or node.pkg is None or node.executable is None:
            continue
        if (node.pkg.value, node.executable.value) == (new_node.pkg, new_node.executable):
            return Rejected(
                sentence=f"`{new_node.executable}` of package `{new_node.pkg}` is already in the "
                f"config as `{node.full_name}` ({node.span})",
                help="keep it, or choose another name for the new node",
            )
    return None


def _names(node: Node) -> tuple[str, ...]:
    own = (node.name.value,) if node.name else ()
    return (node.full_name, node.node_name, *own)
