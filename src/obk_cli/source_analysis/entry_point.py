"""Read what the source behind an entry point defines for the node that it runs."""

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from obelisk_spec.suggestions import did_you_mean
from obk_cli.config.environment import CodeFault, NodeCode, NodeFacts, SourceFaults
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.base_calls import check_base_configure, check_base_constructor
from obk_cli.source_analysis.blocking_calls import check_blocking_calls
from obk_cli.source_analysis.callbacks import check_callbacks
from obk_cli.source_analysis.class_hierarchy import ClassSource, Lineage, lineage_of
from obk_cli.source_analysis.component_use import control_lengths, key_uses
from obk_cli.source_analysis.imports import (
    EntryFunction,
    ImportPlaces,
    check_imports,
    imported_modules,
)
from obk_cli.source_analysis.live_parameters import check_assignments
from obk_cli.source_analysis.modules import (
    Definition,
    LoadModule,
    Module,
    ModuleLibrary,
    UnreadableSourceError,
    dotted_name,
    span_of,
)
from obk_cli.source_analysis.registrations import registrations_of
from obk_cli.source_analysis.undefined_names import check_names, what_import_runs

__all__ = ["entry_function", "read_node_code"]

_SPIN = "spin_obelisk"


@dataclass(frozen=True, slots=True)
class _Spun:
    """A node class that a program runs, with `spin_obelisk` or with an executor of its own."""

    node_type: ast.expr
    module: Module
    has_arguments: bool
    """Whether the class is instantiated with arguments other than its defaults."""
    may_have_threads: bool
    """Whether the program chooses an executor that may run callbacks in parallel."""
    by_library: bool = True
    """Whether `spin_obelisk` runs it."""


def read_node_code(
    module: str,
    function: str | None,
    load: LoadModule,
    places: ImportPlaces | None = None,
) -> NodeCode | None:
    """What the source behind an entry point defines; None if that cannot be determined.

    Args:
        module: dotted name of the module.
        function: the function that the entry point calls; None for a module run as a program.
        load: returns modules by their dotted names.
        places: where imported modules are searched for; None: imports are not checked.
    """
    library = ModuleLibrary(load)
    try:
        entry = library.module(module)
        return None if entry is None else _read(entry, function, library, places)
    except UnreadableSourceError as error:
        return CodeFault(
            message=f"is not valid Python: {error.message}", place=error.span.path, span=error.span
        )
    except RecursionError:
        return None  # for example, for an expression with thousands of terms


def _read(
    entry: Module, function: str | None, library: ModuleLibrary, places: ImportPlaces | None
) -> NodeCode | None:
    if function is not None and function not in entry.names and not entry.has_more_names:
        return _no_function(entry, function)
    module, runs = entry_function(entry, function, library)
    spun = list(_spun_in(runs, module)) or list(_created_in(runs, module, library))
    found = _class_of(spun[0], library) if len(spun) == 1 else None
    lineage = lineage_of(found, library) if found else None
    faults = tuple(_faults_of_modules(entry, (module, runs), lineage, library, places))
    code = _node_code(lineage, library, spun[0], faults) if lineage else None
    return code or (SourceFaults(findings=faults) if faults else None)


def entry_function(entry: Module, function: str | None, library: ModuleLibrary) -> EntryFunction:
    """What runs after the imports: the whole module of a program, or the entry function's body."""
    if function is None:
        return entry, entry.tree.body
    definition = library.definition(f"{entry.name}.{function}")
    match definition.node if definition else None:
        case ast.FunctionDef(body=body) | ast.AsyncFunctionDef(body=body) if definition:
            return definition.module, body
    return entry, []


def _faults_of_modules(
    entry: Module,
    function: EntryFunction,
    lineage: Lineage | None,
    library: ModuleLibrary,
    places: ImportPlaces | None,
) -> Iterator[Diagnostic]:
    """Failing imports and undefined names in all code that runs at the node's start."""
    modules: tuple[Module, ...] = (entry,)
    failing: tuple[Diagnostic, ...] = ()
    if places is not None:
        modules = imported_modules(entry, function, library, places)
        failing = tuple(check_imports(modules, function, library, places))
        yield from failing
    sources = lineage.classes if lineage else ()
    for module in dict.fromkeys((*modules, *(s.module for s in sources if not s.is_of_library))):
        starts = function[1] if function[0] is module else ()
        reported = [f.span.text for f in failing if f.span.source is module.source]
        certain = tuple(check_names(module, (*what_import_runs(module), *starts), reported))
        yield from certain
        # A branch of a method may never run.
        methods = (m for s in sources if s.module is module for m in s.methods())
        reported += [finding.span.text for finding in certain]
        yield from check_names(module, methods, reported, "warning")


def _no_function(entry: Module, function: str) -> CodeFault:
    first = Span.at(entry.source, 1, 1, max(len(entry.source.line(1).rstrip()), 1))
    functions = [
        name
        for name, node in entry.names.items()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    message = f"does not define `{function}`, the function that the entry point refers to"
    help = did_you_mean(function, functions)
    return CodeFault(message=message, place=entry.source.path, span=first, help=help)


def _spun_in(body: Iterable[ast.stmt], module: Module) -> Iterator[_Spun]:
    for statement in body:
        for node in ast.walk(statement):
            if not isinstance(node, ast.Call):
                continue
            called = dotted_name(node.func, module) or ""
            if called.rpartition(".")[2] != _SPIN:
                continue
            keywords = {keyword.arg: keyword.value for keyword in node.keywords}
            node_type = node.args[1] if len(node.args) > 1 else keywords.get("node_type")
            if node_type is not None:
                has_arguments = len(node.args) > 3 or "node_kwargs" in keywords or None in keywords
                executor = node.args[2] if len(node.args) > 2 else keywords.get("executor_type")
                is_parallel = executor is not None and not _is_single_threaded(executor, module)
                yield _Spun(node_type, module, has_arguments, is_parallel or None in keywords)


def _created_in(
    body: Iterable[ast.stmt], module: Module, library: ModuleLibrary
) -> Iterator[_Spun]:
    """The node classes that a program instantiates itself."""
    calls = (n for statement in body for n in ast.walk(statement) if isinstance(n, ast.Call))
    for call in calls:
        has_arguments = bool(call.args or call.keywords)
        spun = _Spun(call.func, module, has_arguments, may_have_threads=True, by_library=False)
        found = _class_of(spun, library)
        lineage = lineage_of(found, library) if found else None
        if lineage is not None and lineage.is_node:
            yield spun


def _is_single_threaded(executor: ast.expr, module: Module) -> bool:
    name = dotted_name(executor, module) or ""
    is_none = isinstance(executor, ast.Constant) and executor.value is None
    return is_none or name == "rclpy.executors.SingleThreadedExecutor"


def _class_of(spun: _Spun, library: ModuleLibrary) -> ClassSource | None:
    dotted = dotted_name(spun.node_type, spun.module) or ""
    found: Definition | None = library.definition(dotted)
    if found is None or not isinstance(found.node, ast.ClassDef):
        return None
    return ClassSource(found.module, found.node)


def _node_code(
    lineage: Lineage, library: ModuleLibrary, spun: _Spun, faults: tuple[Diagnostic, ...]
) -> NodeFacts | None:
    if not lineage.is_node:
        return None
    source = lineage.classes[0]
    found = registrations_of(lineage, library, has_arguments=spun.has_arguments)
    without_base = check_base_constructor(*found.without_base) if found.without_base else ()
    configure = check_base_configure(lineage)
    callbacks = check_callbacks(found.callbacks.values(), lineage, library)
    waits = () if spun.may_have_threads else check_blocking_calls(lineage)
    return NodeFacts(
        class_name=source.node.name,
        span=span_of(source.node, source.module.source),
        components=tuple(found.components.values()),
        parameters=tuple(found.parameters.values()),
        knows_components=found.knows_components,
        knows_parameters=found.knows_parameters,
        missing_methods=tuple(lineage.missing_methods()),
        control_lengths=tuple(control_lengths(lineage, library)),
        key_uses=tuple(key_uses(lineage, library)),
        findings=(
            *faults,
            *without_base,
            *configure,
            *check_assignments(lineage, found.parameters.values()),
            *found.invalid.values(),
            *callbacks,
            *waits,
        ),
        can_damp=lineage.can_damp,
        words=frozenset(_words(lineage)),
        is_run_by_library=spun.by_library,
    )


def _words(lineage: Lineage) -> Iterator[str]:
    own = (source.node for source in lineage.classes if not source.is_of_library)
    for node in (inner for outer in own for inner in ast.walk(outer)):
        match node:
            case ast.Attribute(attr=word) | ast.Constant(value=str(word)):
                yield word
