"""From an entry point to what its source says of the node that it runs."""

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from obelisk_spec.suggestions import did_you_mean
from obk_cli.config.environment import CodeFault, ControlLength, NodeFacts
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage, lineage_of
from obk_cli.source_analysis.modules import (
    Definition,
    Library,
    LoadModule,
    Module,
    UnreadableSourceError,
    dotted_name,
    message_type,
    span_of,
    value_of,
)
from obk_cli.source_analysis.registrations import registrations_of

__all__ = ["read_node_code"]

_FIELDS = ("u_mujoco", "u")
_PACKAGE = "obelisk_control_msgs/"


def control_lengths(lineage: Lineage, library: Library) -> Iterator[ControlLength]:
    """Every `message.u_mujoco = [...]` with a list of known length."""
    for source in lineage.classes:
        if not source.is_of_library:
            for method in source.methods():
                yield from _in_method(method, source, library)


def _in_method(method: Function, source: ClassSource, library: Library) -> Iterator[ControlLength]:
    messages: set[str] = set()
    for node in ast.walk(method):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call(func=made)):
                made_type = message_type(value_of(made, source.module, library, {})) or ""
                if made_type.startswith(_PACKAGE):
                    messages.add(name)
    for node in ast.walk(method):
        match node:
            case ast.Assign(
                targets=[ast.Attribute(value=ast.Name(id=name), attr=field)],
                value=ast.List(elts=values) | ast.Tuple(elts=values),
            ) if field in _FIELDS and name in messages:
                # An empty list is filled by what follows.
                if values and not any(isinstance(value, ast.Starred) for value in values):
                    span = span_of(node, source.module.source)
                    yield ControlLength(field=field, length=len(values), span=span)


_SPIN = "spin_obelisk"


@dataclass(frozen=True, slots=True)
class _Spun:
    """What a `spin_obelisk` call is given."""

    node_type: ast.expr
    module: Module
    has_arguments: bool
    """Whether the class is made with arguments other than its defaults."""


def read_node_code(
    module: str, function: str | None, load: LoadModule
) -> NodeFacts | CodeFault | None:
    """What the source behind an entry point says; None where it cannot be known from reading.

    Args:
        module: dotted name of the module.
        function: what the entry point calls; None for a module that is run as a program.
        load: gives modules by their dotted names.
    """
    library = Library(load)
    try:
        entry = library.module(module)
        return None if entry is None else _read(entry, function, library)
    except UnreadableSourceError as error:
        return CodeFault(
            message=f"is not Python: {error.message}", place=error.span.path, span=error.span
        )


def _read(entry: Module, function: str | None, library: Library) -> NodeFacts | CodeFault | None:
    if function is None:
        spun = list(_spun_in(entry.tree.body, entry))
    else:
        if function not in entry.names and not entry.has_more_names:
            return _no_function(entry, function)
        definition = library.definition(f"{entry.name}.{function}")
        if definition is None or isinstance(definition.node, ast.expr | ast.ClassDef):
            return None
        spun = list(_spun_in(definition.node.body, definition.module))
    if len(spun) != 1:
        return None
    found = _class_of(spun[0], library)
    return None if found is None else _node_code(found, library, spun[0].has_arguments)


def _no_function(entry: Module, function: str) -> CodeFault:
    first = Span.at(entry.source, 1, 1, max(len(entry.source.line(1).rstrip()), 1))
    functions = [
        name
        for name, node in entry.names.items()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    message = f"has no function `{function}`, which the entry point names"
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
                yield _Spun(node_type, module, has_arguments)


def _class_of(spun: _Spun, library: Library) -> ClassSource | None:
    dotted = dotted_name(spun.node_type, spun.module) or ""
    found: Definition | None = library.definition(dotted)
    if found is None or not isinstance(found.node, ast.ClassDef):
        return None
    return ClassSource(found.module, found.node)


def _node_code(source: ClassSource, library: Library, has_arguments: bool) -> NodeFacts | None:
    lineage = lineage_of(source, library)
    if not lineage.is_node:
        return None
    found = registrations_of(lineage, library, has_arguments=has_arguments)
    return NodeFacts(
        class_name=source.node.name,
        span=span_of(source.node, source.module.source),
        components=tuple(found.components.values()),
        parameters=tuple(found.parameters.values()),
        knows_components=found.knows_components,
        knows_parameters=found.knows_parameters,
        missing_methods=tuple(lineage.missing_methods()),
        control_lengths=tuple(control_lengths(lineage, library)),
        can_damp=lineage.can_damp,
    )
