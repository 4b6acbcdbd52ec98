"""Text -> tree -> resolved -> typed -> checked -> plan: the one module that knows the order.

The library entry for everything that needs a config: the command line, the launcher, editors.
"""

from bisect import bisect_left, insort
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from obk_cli.check import check_stack
from obk_cli.config import Stack
from obk_cli.diagnostics import Diagnostic, counted, found, in_order, worst
from obk_cli.files import STANDARD_INPUT, read_bytes
from obk_cli.lower import lower_stack
from obk_cli.node_code import NodeCode
from obk_cli.parse import (
    MOST_VALUES,
    decode_source,
    parse_source,
    too_many_values,
)
from obk_cli.plan import Plan
from obk_cli.read.stack import read_stack
from obk_cli.resolve.include import Loaded, resolve_includes
from obk_cli.resolve.overrides import resolve_overrides
from obk_cli.resolve.paths import resolve_paths
from obk_cli.resolve.ray_casters import resolve_ray_casters
from obk_cli.resolve.types import resolve_types
from obk_cli.resolve.variables import resolve_variables
from obk_cli.silence import check_ignores, said_on_command_line, silence
from obk_cli.source import LONGEST_FILE_BYTES, SourceFile, Span
from obk_cli.surroundings import Surroundings
from obk_cli.tree import Tree, TreeMap
from obk_cli.workspace.environment import MachineSurroundings
from obk_cli.workspace.path_suggestions import did_you_mean_config

__all__ = ["Options", "Outcome", "compile_config", "compile_source"]

_LOSES_TEXT = frozenset(f"OBK{number:03}" for number in (2, 3, 6, 7, 8, 9, 10, 13))
"""Faults after which part of the config is not there to be checked."""
_OF_WHOLE_NODES = ("OBK207", "OBK208", "OBK306", "OBK307", "OBK405")
"""Findings about what a node lacks: it may stand under a key that was written twice."""
_FOLLOWS: Mapping[str, str | tuple[str, ...]] = {
    "OBK011": "OBK",
    "OBK109": ("OBK203", "OBK204"),
    "OBK407": "OBK205",
}
"""Finding -> findings about the same text that would tell the same fault once more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a config is compiled."""

    environment: Mapping[str, str]
    """Stands in for `${VAR}`; its AMENT_PREFIX_PATH says where packages are."""
    working_folder: Path
    overrides: tuple[str, ...] = ()
    """`path=value`, as `--set` takes them."""
    ignore: tuple[str, ...] = ()
    """Codes, or beginnings of codes, not to report."""
    surroundings: Surroundings | None = None
    """What to ask about packages and models; None: this machine."""
    read: Callable[[str], bytes | str] = read_bytes
    """What a config file holds, or why it cannot be read."""
    meant: Callable[[str], str | None] = did_you_mean_config
    """What may be meant by the path of a file that cannot be read, as a help line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a config; there is a plan only where no error was found."""

    path: str
    plan: Plan | None
    config: Stack | None
    diagnostics: tuple[Diagnostic, ...] = field(default=())
    spun: frozenset[tuple[str, str]] = frozenset()
    """Package and executable of the nodes whose source says which class it spins."""


def compile_config(path: str, options: Options) -> Outcome:
    """Compile a file; `-` is the standard input."""
    shown = "<standard input>" if path == STANDARD_INPUT else path
    data = options.read(path)
    if isinstance(data, str):
        place = Span.at(SourceFile.of(shown, ""), 1, 1)
        fault = found(
            "OBK001", f"`{shown}` cannot be read: {data}", place, help=options.meant(path)
        )
        return Outcome(path=shown, plan=None, config=None, diagnostics=(fault,))
    source = decode_source(shown, data)
    if isinstance(source, Diagnostic):
        return Outcome(path=shown, plan=None, config=None, diagnostics=(source,))
    return compile_source(source, options)


def compile_source(source: SourceFile, options: Options) -> Outcome:
    """Compile a text; paths in it are relative to the folder of the path it goes by."""
    folder = (options.working_folder / source.path).resolve().parent
    if source.path.startswith("<"):
        folder = options.working_folder
    surroundings = options.surroundings or MachineSurroundings(
        folder, options.working_folder, options.environment
    )
    files = _Files(source, options)
    stack, faults = _front(source, files, options)
    if stack is not None:
        stack = resolve_types(resolve_paths(stack, folder, surroundings), surroundings)
        stack, scan_faults = resolve_ray_casters(stack, files.load_shown)
        faults += scan_faults
        is_whole = files.are_whole and not any(fault.code in _LOSES_TEXT for fault in faults)
        faults += check_stack(stack, surroundings, is_whole=is_whole)
    ignored = tuple(said_on_command_line(code) for code in options.ignore)
    ignored += stack.ignored_codes if stack is not None else ()
    faults += check_ignores(files.sources, ignored)
    codes = [code.value for code in ignored]
    heard = in_order(silence(tuple(_causes(faults, are_whole=files.are_whole)), codes))
    plan = lower_stack(stack) if stack is not None and worst(heard) != "error" else None
    return Outcome(
        path=source.path,
        plan=plan,
        config=stack,
        diagnostics=counted(heard),
        spun=_spun(plan, surroundings),
    )


def _spun(plan: Plan | None, surroundings: Surroundings) -> frozenset[tuple[str, str]]:
    programs = {(node.package, node.executable) for node in (plan.processes if plan else ())}
    return frozenset(
        program
        for program in programs
        if isinstance(surroundings.read_node_code(*program), NodeCode)
    )


def _causes(faults: tuple[Diagnostic, ...], *, are_whole: bool) -> Iterator[Diagnostic]:
    """The findings without those that only follow from another one about the same text."""
    columns: dict[tuple[str, str, int], list[int]] = defaultdict(list)
    for fault in faults:
        if fault.code in _FOLLOWS:
            insort(columns[fault.code, fault.span.path, fault.span.line], fault.span.column)
    for fault in faults:
        if not are_whole and fault.code in _OF_WHOLE_NODES:
            continue
        if not any(
            fault.code.startswith(follows)
            and fault.code != code
            and _covers(fault.span, columns.get((code, fault.span.path, fault.span.line), ()))
            for code, follows in _FOLLOWS.items()
        ):
            yield fault


def _covers(span: Span, columns: Sequence[int]) -> bool:
    """Whether any of the columns, which ascend, is within the stretch on its first line."""
    first = bisect_left(columns, span.column)
    return first < len(columns) and columns[first] < span.first_line_end


def _front(
    source: SourceFile, files: "_Files", options: Options
) -> tuple[Stack | None, tuple[Diagnostic, ...]]:
    """From text to the typed config."""
    tree, faults = files.parse(source)
    if tree is None:
        if not faults:
            place = Span.at(source, 1, 1)
            faults = (found("OBK114", "the file is empty, not a config", place),)
        return None, faults
    if isinstance(tree, TreeMap):
        tree, include_faults = resolve_includes(tree, source.path, files.load)
        faults += include_faults
        tree, override_faults = resolve_overrides(tree, options.overrides, _parse_value)
        faults += override_faults
    stack, read_faults = read_stack(tree)
    return stack, faults + read_faults


def _parse_value(source: SourceFile) -> tuple[Tree | None, tuple[Diagnostic, ...]]:
    parsed = parse_source(source)
    return parsed.tree, parsed.diagnostics


class _Files:
    """The files of one config: each read once, all together no longer than one may be."""

    def __init__(self, source: SourceFile, options: Options) -> None:
        self._options = options
        self.sources = [source]
        self.are_whole = True
        """Whether nothing was left out of what could be read."""
        self._bytes = len(source.text.encode("utf-8", "surrogatepass"))
        self._values = 0
        self._read: dict[str, tuple[Loaded, int]] = {}
        self._refused: Diagnostic | None = None

    def parse(self, source: SourceFile) -> tuple[Tree | None, tuple[Diagnostic, ...]]:
        """The tree of a file, its variables replaced; its values count."""
        parsed = parse_source(source, values_before=self._values)
        self._values += parsed.values
        self.are_whole = self.are_whole and parsed.is_whole
        if parsed.tree is None:
            return None, parsed.diagnostics
        if "${" not in source.text:  # a long walk that most files need not take
            return parsed.tree, parsed.diagnostics
        tree, faults = resolve_variables(parsed.tree, self._options.environment)
        return tree, parsed.diagnostics + faults

    def load_shown(self, path: Path) -> Loaded:
        """A file under the path that a person in the working folder would write."""
        is_near = path.is_relative_to(self._options.working_folder)
        shown = path.relative_to(self._options.working_folder) if is_near else path
        return self.load(str(path), shown=str(shown))

    def load(self, path: str, *, shown: str | None = None) -> Loaded:
        """What a further file holds; each time that it is asked for, its values count."""
        if self._refused is not None:
            return Loaded(diagnostics=(self._refused,))
        start = Span.at(SourceFile.of(shown or path, ""), 1, 1)
        before = self._values
        if path in self._read:
            loaded, values = self._read[path]
            self._values += values
            if self._values > MOST_VALUES:
                self._refused = too_many_values(start, values_before=before)
        else:
            loaded = self._load(path, start)
            self._read[path] = (loaded, self._values - before)
        return loaded if self._refused is None else Loaded(diagnostics=(self._refused,))

    def _load(self, path: str, start: Span) -> Loaded:
        # Only the config itself may be the standard input.
        data = self._options.read(f"./{path}" if path == STANDARD_INPUT else path)
        if isinstance(data, str):
            return Loaded(unreadable=data)
        self._bytes += len(data)
        if self._bytes > LONGEST_FILE_BYTES >= len(data):
            message = "this file and those before it are longer than 10 MiB, so it is not read"
            self._refused = found("OBK007", message, start)
            return Loaded()
        source = decode_source(start.path, data)
        if isinstance(source, Diagnostic):
            return Loaded(diagnostics=(source,))
        self.sources.append(source)
        tree, faults = self.parse(source)
        self._refused = next((fault for fault in faults if fault.code == "OBK006"), None)
        return Loaded(tree=tree, diagnostics=faults)
