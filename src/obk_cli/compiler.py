"""Compile a config: load -> read -> locate -> check -> lower. Only this module knows the order.

The entry point for everything that reads configs: the command line, the launcher, editors.
"""

import gc
from bisect import bisect_left, insort
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from obelisk_spec.suggestions import list_names
from obk_cli.check import check_stack
from obk_cli.config.environment import Environment
from obk_cli.config.loader import ConfigFiles, load_config
from obk_cli.config.locate import locate_stack
from obk_cli.config.model import Stack
from obk_cli.config.reader import read_stack
from obk_cli.config.suppressions import check_ignores, said_on_command_line, silence
from obk_cli.config.yaml_parser import decode_source
from obk_cli.diagnostics.diagnostic import Diagnostic, counted, found, in_order, worst
from obk_cli.diagnostics.rules import LOCKSTEP_FAMILY
from obk_cli.diagnostics.source import SourceFile, Span
from obk_cli.files import STANDARD_INPUT, read_bytes
from obk_cli.plan.lower import lower_stack
from obk_cli.plan.plan import Plan
from obk_cli.workspace.config_files import did_you_mean_config, similar_configs
from obk_cli.workspace.environment import MachineEnvironment

__all__ = ["Options", "Outcome", "compile_config", "compile_source"]

_LOSES_TEXT = frozenset(f"OBK{number:03}" for number in (2, 3, 6, 7, 8, 9, 10, 13))
"""Faults after which part of the config cannot be checked."""
_OF_WHOLE_NODES = ("OBK207", "OBK208", "OBK306", "OBK307", "OBK405")
"""Findings about parts missing from a node that may be lost with other text."""
_OF_FRAGMENTS = (*_OF_WHOLE_NODES, "OBK102", "OBK201", "OBK203", "OBK204", "OBK209", "OBK321")
"""Findings about missing parts of a file, which the including config may have."""
_FOLLOWS: Mapping[str, str | tuple[str, ...]] = {
    "OBK011": "OBK",
    "OBK109": ("OBK203", "OBK204"),
    "OBK407": "OBK205",
    "OBK426": "OBK604",
}
"""Finding -> findings about the same text that would report the same fault again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a config is compiled."""

    variables: Mapping[str, str]
    """Values for `${VAR}`; AMENT_PREFIX_PATH is searched for packages."""
    working_folder: Path
    overrides: tuple[str, ...] = ()
    """`path=value`, as for `--set`."""
    ignore: tuple[str, ...] = ()
    """Codes or prefixes of codes not to report."""
    environment: Environment | None = None
    """Where packages and models are looked up; None: this machine."""
    read: Callable[[str], bytes | str] = read_bytes
    """Returns a config file's content, or why it cannot be read."""
    meant: Callable[[str], str | None] = did_you_mean_config
    """Returns a help line with similar paths for a file that cannot be read."""
    for_test: bool = False
    """Whether to report code that may behave differently between lockstep runs, too (OBK6xx)."""
    including: Callable[[str], tuple[str, ...]] = lambda _: ()
    """Returns the configs that include a file; if any, the file is checked as a fragment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of compiling a config; the plan is None if it has errors or is a fragment."""

    path: str
    plan: Plan | None
    config: Stack | None
    diagnostics: tuple[Diagnostic, ...] = field(default=())
    environment: Environment | None = None
    """The packages and models that were looked up; None if none were."""
    files: tuple[str, ...] = ()
    """The config and the files that it includes."""

    @property
    def hazards(self) -> tuple[Diagnostic, ...]:
        """Code that may behave differently between lockstep runs; empty without `for_test`."""
        return tuple(d for d in self.diagnostics if d.code.startswith(LOCKSTEP_FAMILY))


def compile_config(path: str, options: Options) -> Outcome:
    """Compile a file; `-` is standard input."""
    shown = "<stdin>" if path == STANDARD_INPUT else path
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


@contextmanager
def _no_collection() -> Iterator[None]:
    """Disable garbage collection: a long config makes a million objects but no cycles."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@_no_collection()
def compile_source(source: SourceFile, options: Options) -> Outcome:
    """Compile source text; paths in it are relative to the folder of `source.path`."""
    folder = (options.working_folder / source.path).resolve().parent
    if source.path.startswith("<"):
        folder = options.working_folder
    environment = options.environment or MachineEnvironment(
        folder, options.working_folder, options.variables
    )
    files = ConfigFiles(
        source,
        variables=options.variables,
        working_folder=options.working_folder,
        read=options.read,
        similar=similar_configs,
    )
    tree, faults = load_config(source, files, options.overrides)
    is_whole = files.are_whole and not any(fault.code in _LOSES_TEXT for fault in faults)
    stack: Stack | None = None
    if tree is not None:
        stack, read_faults = read_stack(tree)
        faults += read_faults
    if stack is not None:
        stack, locate_faults = locate_stack(stack, folder, files, environment)
        faults += locate_faults
        faults += check_stack(stack, environment, is_whole=is_whole, for_test=options.for_test)
    ignored = tuple(said_on_command_line(code) for code in options.ignore)
    ignored += stack.ignored_codes if stack is not None else ()
    faults += check_ignores(files.sources, ignored)
    codes = [code.value for code in ignored]
    causes = tuple(_causes(faults, is_whole=is_whole))
    including = _including(source.path, causes, options)
    if including:
        causes = tuple(_of_fragment(causes, source, including))
    reported = in_order(silence(causes, codes))
    is_stack = stack is not None and worst(reported) != "error" and not including
    plan = lower_stack(stack, environment) if stack is not None and is_stack else None
    return Outcome(
        path=source.path,
        plan=plan,
        config=stack,
        diagnostics=counted(reported),
        environment=environment,
        files=tuple(source.path for source in files.sources),
    )


def _including(path: str, faults: Iterable[Diagnostic], options: Options) -> tuple[str, ...]:
    """The configs that include a file; searched only if the file seems incomplete."""
    incomplete = (f for f in faults if f.code in _OF_FRAGMENTS)
    is_whole = all(f.severity == "info" and f.code != "OBK201" for f in incomplete)
    if path.startswith("<") or is_whole:
        return ()
    return options.including(path)


def _of_fragment(
    faults: Iterable[Diagnostic], source: SourceFile, including: Sequence[str]
) -> Iterator[Diagnostic]:
    yield found(
        "OBK016",
        f"{list_names(including, most=3)} {'includes' if len(including) == 1 else 'include'} "
        "this file, so it is checked as a fragment: keys and nodes that may be defined "
        "elsewhere are not reported as missing",
        Span.at(source, 1, 1),
        help=f"run `obk validate {including[0]}` to check the whole stack",
    )
    yield from (fault for fault in faults if fault.code not in _OF_FRAGMENTS)


def _causes(faults: tuple[Diagnostic, ...], *, is_whole: bool) -> Iterator[Diagnostic]:
    """The findings, without those that only follow from another one about the same text."""
    columns: dict[tuple[str, str, int], list[int]] = defaultdict(list)
    for fault in faults:
        if fault.code in _FOLLOWS:
            insort(columns[fault.code, fault.span.path, fault.span.line], fault.span.column)
    for fault in faults:
        if not is_whole and fault.code in _OF_WHOLE_NODES:
            continue
        if not any(
            fault.code.startswith(follows)
            and fault.code != code
            and _covers(fault.span, columns.get((code, fault.span.path, fault.span.line), ()))
            for code, follows in _FOLLOWS.items()
        ):
            yield fault


def _covers(span: Span, columns: Sequence[int]) -> bool:
    """Whether a span covers any of the columns (ascending) on its first line."""
    first = bisect_left(columns, span.column)
    return first < len(columns) and columns[first] < span.first_line_end
