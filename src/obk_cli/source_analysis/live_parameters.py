"""Read what a node's classes declare with `Parameter` in their bodies: types, limits, units.

OBK429: methods that assign to one of these.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from obelisk_spec.parameter_notes import ParameterNotes
from obelisk_spec.values import is_number
from obk_cli.config.environment import CodeParameter, kind_of_value
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.source_analysis.class_hierarchy import Function, Lineage
from obk_cli.source_analysis.modules import (
    Module,
    ModuleLibrary,
    at_top_level,
    dotted_name,
    span_of,
)

__all__ = ["check_assignments", "class_parameters"]

PARAMETER_CLASS: Final = "obelisk_py.core.parameter.Parameter"
_NAME: Final = "Parameter"
_ENUMS: Final = ("enum.Enum", "enum.IntEnum", "enum.StrEnum")


def class_parameters(
    lineage: Lineage, library: ModuleLibrary
) -> tuple[Mapping[str, CodeParameter], bool]:
    """The parameters by name, and whether they are complete; a constant overrides a base's."""
    declared: dict[str, CodeParameter] = {}
    are_all = True
    for source in reversed(lineage.classes):
        for statement in at_top_level(source.node.body):
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    pass
                case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                    pass
                case _:
                    continue
            called = _called(value, source.module)
            if called == PARAMETER_CLASS and isinstance(value, ast.Call):
                declared[name] = _declared(name, value, source.module, library)
            else:
                declared.pop(name, None)
                # The import fails, which is reported separately.
                are_all &= called.rpartition(".")[2] != _NAME
    return declared, are_all


def check_assignments(
    lineage: Lineage, parameters: Iterable[CodeParameter]
) -> Iterator[Diagnostic]:
    """Report `self.name = ...` for each name that is declared with `Parameter`."""
    declared = {one.name: one for one in parameters if one.notes is not None}
    for source in lineage.classes if declared else ():
        for method in () if source.is_of_library else source.methods():
            for node in _assigned(method):
                if node.attr in declared:
                    yield _assignment(node, declared[node.attr], source.module)


def _assigned(method: Function) -> Iterator[ast.Attribute]:
    """The attributes that a method assigns to its first argument."""
    self_name = next((a.arg for a in (*method.args.posonlyargs, *method.args.args)), None)
    rest: list[ast.AST] = [] if method.decorator_list else list(method.body)
    while rest:
        node = rest.pop(0)
        match node:
            case ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
                continue  # may have a `self` of its own
            case ast.Attribute(value=ast.Name(id=name), ctx=ast.Store()) if name == self_name:
                yield node
        rest += ast.iter_child_nodes(node)


def _assignment(node: ast.Attribute, parameter: CodeParameter, module: Module) -> Diagnostic:
    name = parameter.name
    return found(
        "OBK429",
        f"this assignment does not set the ROS parameter `{name}`",
        span_of(node, module.source),
        help="use another name, or `self.set_parameters([...])`",
        related=(Related(message="the parameter", span=parameter.span),),
    )


def _called(value: ast.expr, module: Module) -> str:
    """The full name of the callee, as far as it is known."""
    if not isinstance(value, ast.Call):
        return ""
    own = value.func.id if isinstance(value.func, ast.Name) else ""
    return dotted_name(value.func, module) or own


def _declared(name: str, call: ast.Call, module: Module, library: ModuleLibrary) -> CodeParameter:
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    default = call.args[0] if call.args else given.get("default")
    choices = _choices(default, module, library)
    value = _literal(default, module, library)
    limits = {
        limit: value if is_number(value) else None
        for limit in ("ge", "le")
        for value in (_literal(given.get(limit), module, library),)
    }
    unit = _literal(given.get("unit"), module, library)
    kind = "string" if choices else kind_of_value(value)
    return CodeParameter(
        name=name,
        kind=kind,
        span=span_of(call, module.source),
        notes=ParameterNotes(
            unit=unit if isinstance(unit, str) else "",
            least=limits["ge"],
            most=limits["le"],
            choices=choices,
            length=len(value) if isinstance(value, tuple) else None,
        ),
    )


def _literal(expression: ast.expr | None, module: Module, library: ModuleLibrary) -> object:
    """A literal value, here or where its name is defined; None if computed."""
    node: ast.AST | None = expression
    if isinstance(expression, ast.Name | ast.Attribute):
        definition = library.definition(dotted_name(expression, module) or "")
        node = definition.node if definition is not None else None
    if node is None:
        return None
    try:
        value: object = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(value, list | tuple) and {type(item) for item in value} == {int, float}:
        return type(value)(float(item) for item in value)
    return value


def _choices(default: ast.expr | None, module: Module, library: ModuleLibrary) -> tuple[str, ...]:
    """ROS names of the members of the enum to which the default belongs; empty without an enum."""
    if not isinstance(default, ast.Attribute):
        return ()
    definition = library.definition(dotted_name(default.value, module) or "")
    if definition is None or not isinstance(definition.node, ast.ClassDef):
        return ()
    bases = [dotted_name(base, definition.module) for base in definition.node.bases]
    if not any(base in _ENUMS for base in bases):
        return ()
    members = {
        target.id: _literal(statement.value, definition.module, library)
        for statement in definition.node.body
        if isinstance(statement, ast.Assign)
        for target in statement.targets
        if isinstance(target, ast.Name)
    }
    texts = [value for value in members.values() if isinstance(value, str)]
    is_computed = "enum.StrEnum" in bases and len(texts) < len(members)
    if is_computed:
        return ()
    return tuple(texts if len(texts) == len(members) else members)
