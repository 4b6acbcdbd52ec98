"""Calls in a node's source: what a registration says, and what arguments a constructor gets."""

import ast
from dataclasses import dataclass
from typing import Final

from obk_cli.code.lineage import Function
from obk_cli.code.modules import Library, Module, span_of
from obk_cli.code.values import UNKNOWN, Environment, Value, message_type, value_of
from obk_cli.config import ComponentKind
from obk_cli.node_code import CodeComponent

__all__ = ["Scope", "bound_arguments", "register_call", "scope_of"]

_REGISTRATIONS: Final[dict[str, tuple[ComponentKind, tuple[str, ...]]]] = {
    "register_obk_publisher": ("publisher", ("ros_parameter", "key", "msg_type", "default")),
    "register_obk_subscription": (
        "subscriber",
        ("ros_parameter", "callback", "key", "msg_type", "default"),
    ),
    "register_obk_timer": ("timer", ("ros_parameter", "callback", "key", "default")),
}
"""Method -> what it registers, and its positional parameters."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Where a call stands: its module, the local names that are known, the name of `self`."""

    module: Module
    local: Environment
    self_name: str

    def is_self(self, node: ast.AST) -> bool:
        """Whether an expression is the node itself."""
        return isinstance(node, ast.Name) and node.id == self.self_name


def scope_of(function: Function, module: Module, local: Environment) -> Scope:
    """The scope of a method's body; local names that are assigned are computed at run time."""
    arguments = [*function.args.posonlyargs, *function.args.args]
    self_name = arguments[0].arg if arguments else ""
    assigned = {
        n.id: UNKNOWN
        for n in ast.walk(function)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
    return Scope(module, {**local, **assigned}, self_name)


def register_call(
    name: str, call: ast.Call, scope: Scope, library: Library
) -> CodeComponent | str | None:
    """The component that a call registers; text: why it is not known; None: no registration."""
    if name not in _REGISTRATIONS:
        return None
    kind, positional = _REGISTRATIONS[name]
    if any(isinstance(a, ast.Starred) for a in call.args) or any(
        k.arg is None for k in call.keywords
    ):
        return "its arguments are computed"
    given: dict[str, ast.expr] = dict(zip(positional, call.args, strict=False))
    given.update({k.arg: k.value for k in call.keywords if k.arg})
    values: dict[str, Value] = {
        key: value_of(given.get(key), scope.module, library, scope.local)
        for key in ("ros_parameter", "key", "msg_type", "default")
    }
    names = [values["ros_parameter"], values["key"]]
    if not any(isinstance(value, str) for value in names):
        return "its names are computed"
    required = (
        value_of(given["required"], scope.module, library, scope.local)
        if "required" in given
        else True
    )
    return CodeComponent(
        kind=kind,
        ros_parameter=_text(values["ros_parameter"]),
        key=_text(values["key"]),
        msg_type=message_type(values["msg_type"]),
        is_required=required is True and values["default"] is None,
        is_optional=required is False,
        has_default=values["default"] is not None,
        is_named_in_full=UNKNOWN not in names,
        is_of_library=False,
        span=span_of(call, scope.module.source),
    )


def _text(value: Value) -> str | None:
    return value if isinstance(value, str) else None


def bound_arguments(
    function: Function,
    module: Module,
    call: tuple[ast.Call, Scope] | None,
    library: Library,
    *,
    is_open: bool,
) -> Environment:
    """The values of a constructor's parameters; without a call, those of its defaults.

    `**kwargs` counts as None where nothing is in it; `is_open` says that arguments may be given
    that cannot be seen.
    """
    arguments = function.args
    positional = [*arguments.posonlyargs, *arguments.args]
    local: dict[str, Value] = {a.arg: UNKNOWN for a in (*positional, *arguments.kwonlyargs)}
    without_default = len(positional) - len(arguments.defaults)
    defaults = [
        *zip(positional[without_default:], arguments.defaults, strict=True),
        *zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True),
    ]
    for parameter, default in defaults:
        if default is not None:
            local[parameter.arg] = value_of(default, module, library, {})
    passed: dict[str, Value] = {}
    if call is not None:
        passed, is_open = _passed(positional, call, library)
    if arguments.kwarg is not None:
        is_empty = not is_open and passed.keys() <= local.keys()
        local[arguments.kwarg.arg] = None if is_empty else UNKNOWN
    if is_open:
        local.update(dict.fromkeys(local, UNKNOWN))
    return {**local, **passed}


def _passed(
    positional: list[ast.arg], call: tuple[ast.Call, Scope], library: Library
) -> tuple[dict[str, Value], bool]:
    """The arguments by name, and whether there may be more that cannot be seen."""
    node, scope = call
    known: dict[str, Value] = {}
    is_open = False
    for parameter, argument in zip(positional[1:], node.args, strict=False):
        if isinstance(argument, ast.Starred):
            is_open = True
            break
        known[parameter.arg] = value_of(argument, scope.module, library, scope.local)
    for keyword in node.keywords:
        value = value_of(keyword.value, scope.module, library, scope.local)
        if keyword.arg is not None:
            known[keyword.arg] = value
        elif value is not None:
            is_open = True
    return known, is_open
