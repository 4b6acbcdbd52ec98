"""Find the values of names in a method's body: its arguments, and names bound to a constant.

Values computed at run time count as unknown.
"""

import ast
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

from obk_cli.source_analysis.class_hierarchy import Function
from obk_cli.source_analysis.modules import (
    UNKNOWN,
    KnownValues,
    Module,
    ModuleLibrary,
    Value,
    at_top_level,
    stored_names,
    value_of,
)

__all__ = ["Scope", "bound_arguments", "mentions", "scope_of"]


@dataclass(frozen=True, slots=True)
class Scope:
    """The context of a call: its module, known local names, and the name of `self`."""

    module: Module
    local: KnownValues
    self_name: str

    def is_self(self, node: ast.AST) -> bool:
        """Whether an expression is the node itself."""
        return isinstance(node, ast.Name) and node.id == self.self_name


def scope_of(
    function: Function, module: Module, library: ModuleLibrary, local: KnownValues
) -> Scope:
    """The scope of a method's body; names assigned several times count as computed at run time."""
    arguments = [*function.args.posonlyargs, *function.args.args]
    self_name = arguments[0].arg if arguments else ""
    known = {**local, **dict.fromkeys(_names_in(function).assigned, UNKNOWN)}
    for name, value in _constants(function):
        known[name] = value_of(value, module, library, known)
    return Scope(module, known, self_name)


def mentions(function: Function, *prefixes: str) -> bool:
    """Whether a function uses an attribute whose name starts with one of these."""
    return any(name.startswith(prefixes) for name in _names_in(function).attributes)


@dataclass(frozen=True, slots=True)
class _Names:
    """The names in a function."""

    assigned: frozenset[str]
    """Local names that are assigned or imported anywhere."""
    attributes: frozenset[str]
    """Attributes of any object that are used or assigned."""


@lru_cache(maxsize=1_000)
def _names_in(function: Function) -> _Names:
    """Both sets of names; cached, because they need a full walk."""
    assigned: set[str] = set()
    attributes: set[str] = set()
    for node in ast.walk(function):
        match node:
            case ast.Attribute(attr=name):
                attributes.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                assigned.add(name)
            case ast.alias(name=name, asname=asname):
                assigned.add(asname or name.partition(".")[0])
    return _Names(frozenset(assigned), frozenset(attributes))


@lru_cache(maxsize=1_000)
def _constants(function: Function) -> tuple[tuple[str, ast.expr], ...]:
    """The local names that are bound only once, to a constant or text, in source order."""
    found: list[tuple[str, ast.expr]] = []
    for statement in at_top_level(function.body):
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                if isinstance(value, ast.Constant | ast.JoinedStr | ast.BinOp | ast.Name):
                    found.append((name, value))
    bound = Counter(stored_names(function)) if found else Counter[str]()
    return tuple((name, value) for name, value in found if bound[name] == 1)


def bound_arguments(
    function: Function,
    module: Module,
    call: tuple[ast.Call, Scope] | None,
    library: ModuleLibrary,
    *,
    is_open: bool,
) -> KnownValues:
    """The values of a constructor's parameters; without a call, the defaults.

    `**kwargs` counts as None if it is empty; with `is_open` there may be unknown arguments.
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
    positional: list[ast.arg], call: tuple[ast.Call, Scope], library: ModuleLibrary
) -> tuple[dict[str, Value], bool]:
    """The arguments by name, and whether there may be unknown ones."""
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
