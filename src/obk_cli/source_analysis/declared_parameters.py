"""Read what `declare_parameter` and `declare_parameters` declare: names, and types of defaults."""

import ast
from collections.abc import Iterator
from typing import Final

from obk_cli.config.environment import CodeParameter, kind_of_value
from obk_cli.source_analysis.modules import ModuleLibrary, dotted_name, span_of, value_of
from obk_cli.source_analysis.scope import Scope

__all__ = ["DECLARING", "declared_parameters"]

DECLARING: Final = ("declare_parameter", "declare_parameters")
"""Methods that declare parameters."""
_NAMED_KINDS: Final = {
    "BOOL": "bool",
    "INTEGER": "int",
    "DOUBLE": "float",
    "STRING": "string",
    "BOOL_ARRAY": "list of bools",
    "INTEGER_ARRAY": "list of ints",
    "DOUBLE_ARRAY": "list of floats",
    "STRING_ARRAY": "list of strings",
}
"""`Parameter.Type` of rclpy -> its name in configs."""
_ARGUMENTS: Final = ("name", "value", "descriptor", "ignore_override")


def declared_parameters(
    method: str, call: ast.Call, scope: Scope, library: ModuleLibrary
) -> tuple[CodeParameter, ...] | None:
    """What `declare_parameter` or `declare_parameters` declares; None if computed."""
    given: dict[str | None, ast.expr] = {k.arg: k.value for k in call.keywords}
    if method == "declare_parameter":
        given.update(zip(_ARGUMENTS, call.args, strict=False))
        found = [_declared("", given, call, scope, library)]
    else:
        given.update(zip(("namespace", "parameters", "ignore_override"), call.args, strict=False))
        namespace = value_of(given.get("namespace"), scope.module, library, scope.local)
        if not isinstance(namespace, str):
            return None
        found = list(_listed(namespace, given, scope, library))
    parameters = tuple(one for one in found if one is not None)
    return parameters if parameters and len(parameters) == len(found) else None


def _listed(
    namespace: str, given: dict[str | None, ast.expr], scope: Scope, library: ModuleLibrary
) -> Iterator[CodeParameter | None]:
    match given.get("parameters"):
        case ast.List(elts=items) | ast.Tuple(elts=items):
            for item in items:
                parts = item.elts if isinstance(item, ast.Tuple) else []
                one: dict[str | None, ast.expr] = {
                    key: given[key] for key in (None, "ignore_override") if key in given
                }
                one.update(zip(_ARGUMENTS, parts, strict=False))
                yield _declared(namespace, one, item, scope, library)


def _declared(
    namespace: str,
    given: dict[str | None, ast.expr],
    place: ast.expr,
    scope: Scope,
    library: ModuleLibrary,
) -> CodeParameter | None:
    name = value_of(given.get("name"), scope.module, library, scope.local)
    if not isinstance(name, str):
        return None
    is_held = None not in given and "ignore_override" not in given
    return CodeParameter(
        name=f"{namespace}.{name}" if namespace else name,
        kind=_kind(given.get("value"), scope, library)
        if is_held and _is_static(given.get("descriptor"))
        else None,
        span=span_of(place, scope.module.source),
    )


def _is_static(descriptor: ast.expr | None) -> bool:
    """Whether a parameter with this descriptor keeps the type of its default, as usual."""
    match descriptor:
        case None:
            return True
        case ast.Call(args=[], keywords=keywords):
            return not any(keyword.arg in (None, "dynamic_typing") for keyword in keywords)
    return False


def _kind(expression: ast.expr | None, scope: Scope, library: ModuleLibrary) -> str | None:
    """The kind of a literal default, or of a type in its place."""
    match expression:
        case None:
            return None
        case ast.Name(id=name) if name in scope.local:
            return None
        case ast.Name() | ast.Attribute():
            dotted = dotted_name(expression, scope.module) or ""
            head, _, last = dotted.rpartition(".")
            if head == "rclpy.parameter.Parameter.Type":
                return _NAMED_KINDS.get(last)
            found = library.definition(dotted) if "." in dotted else None
            return _literal_kind(found.node) if found else None
    return _literal_kind(expression)


def _literal_kind(expression: ast.AST) -> str | None:
    match expression:
        case ast.BinOp(left=ast.List() | ast.Tuple() as items, op=ast.Mult()):
            return _literal_kind(items)
    try:
        return kind_of_value(ast.literal_eval(expression))
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None
