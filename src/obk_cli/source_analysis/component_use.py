"""Find how a node's methods use its components: keys that they look up, controls that they fill."""

import ast
from collections.abc import Iterator
from typing import Final

from obk_cli.config.environment import ControlLength, KeyUse
from obk_cli.config.model import ComponentKind
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.modules import (
    UNKNOWN,
    ModuleLibrary,
    Value,
    dotted_name,
    message_type,
    span_of,
    value_of,
)
from obk_cli.source_analysis.scope import mentions, scope_of
from obk_cli.source_analysis.undefined_names import nodes_without_fallback

__all__ = ["control_lengths", "key_uses"]

_TABLES: Final[dict[str, ComponentKind]] = {
    "obk_publishers": "publisher",
    "obk_subscriptions": "subscriber",
    "obk_timers": "timer",
}
_FIELDS = ("u_mujoco", "u")
_PACKAGE = "obelisk_control_msgs/"
_LONGER: Final = ("append", "extend", "insert")
_FILLED: Final = ("numpy.zeros", "numpy.ones", "numpy.empty", "numpy.full")
_LONGEST = 1_000_000


def _methods(lineage: Lineage) -> Iterator[tuple[ClassSource, Function]]:
    """The methods of the user's classes that are not overridden."""
    for index, source in enumerate(lineage.classes):
        if not source.is_of_library:
            for method in source.methods():
                if lineage.method(method.name) == (index, method):
                    yield source, method


def key_uses(lineage: Lineage, library: ModuleLibrary) -> Iterator[KeyUse]:
    """Every `self.obk_publishers["pub_ctrl"]` with a known key, in source order.

    A table that the code also changes, searches or passes on is left out.
    """
    own = [m for c in lineage.classes if not c.is_of_library for m in c.methods()]
    using = {method for method in own if mentions(method, *_TABLES)}
    left_out = {table for method in using for table in _other_uses(method)}
    for source, method in _methods(lineage):
        if method not in using:
            continue
        arguments = method.args
        names = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        scope = scope_of(method, source.module, library, {a.arg: UNKNOWN for a in names})
        for node in nodes_without_fallback(method):
            match node:
                case ast.Subscript(
                    value=ast.Attribute(value=owner, attr=table), slice=key, ctx=ast.Load()
                ) if table in _TABLES.keys() - left_out and scope.is_self(owner):
                    text = value_of(key, scope.module, library, scope.local)
                    if isinstance(text, str):
                        span = span_of(key, source.module.source)
                        yield KeyUse(kind=_TABLES[table], key=text, span=span)


def _other_uses(method: Function) -> Iterator[str]:
    """The tables that a method uses in another way than to look up a key."""
    nodes = list(ast.walk(method))
    looked_up = {
        id(node.value)
        for node in nodes
        if isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Store)
    }
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr in _TABLES and id(node) not in looked_up:
            yield node.attr


def control_lengths(lineage: Lineage, library: ModuleLibrary) -> Iterator[ControlLength]:
    """Every list of known length that a method writes into a control message."""
    for source, method in _methods(lineage):
        yield from _Lengths(lineage, source, method, library).found()


class _Lengths:
    """Tracks the control messages of one method."""

    def __init__(
        self, lineage: Lineage, source: ClassSource, method: Function, library: ModuleLibrary
    ) -> None:
        self._lineage = lineage
        self._source = source
        self._module = source.module
        self._method = method
        self._library = library
        self._scope = scope_of(method, source.module, library, {})
        arguments = [*method.args.posonlyargs, *method.args.args, *method.args.kwonlyargs]
        self._local = {*self._scope.local, *(a.arg for a in arguments)}

    def found(self) -> Iterator[ControlLength]:
        nodes = list(ast.walk(self._method))
        messages = {
            node.targets[0].id
            for node in nodes
            if isinstance(node, ast.Assign)
            and isinstance(node.targets[0], ast.Name)
            and self._is_control(node.value)
        }
        longer = {field for node in nodes for field in _extended(node)}
        for node in nodes:
            match node:
                case ast.Assign(
                    targets=[ast.Attribute(value=ast.Name(id=name), attr=field)], value=value
                ) if field in _FIELDS and name in messages and (name, field) not in longer:
                    yield from self._length(field, value, node)
                case ast.Call(keywords=keywords) if self._is_control(node):
                    for keyword in keywords:
                        if keyword.arg in _FIELDS:
                            yield from self._length(keyword.arg, keyword.value, keyword.value)

    def _is_control(self, expression: ast.expr) -> bool:
        if not isinstance(expression, ast.Call):
            return False
        value: Value = value_of(expression.func, self._module, self._library, {})
        return (message_type(value) or "").startswith(_PACKAGE)

    def _length(
        self, field: str, value: ast.expr, place: ast.expr | ast.stmt
    ) -> Iterator[ControlLength]:
        length = self._items(value)
        if length:  # an empty list is filled by later statements
            span = span_of(place, self._module.source)
            yield ControlLength(field=field, length=length, span=span)

    def _items(self, expression: ast.expr) -> int | None:
        """The length of a list that is a literal or a repeated literal."""
        match expression:
            case ast.List(elts=items) | ast.Tuple(elts=items):
                return None if any(isinstance(i, ast.Starred) for i in items) else len(items)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                is_swapped = isinstance(right, ast.List | ast.Tuple)
                one = self._items(right if is_swapped else left)
                times = self._whole(left if is_swapped else right)
                return None if one is None or times is None else one * max(times, 0)
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                first, second = self._items(left), self._items(right)
                return None if first is None or second is None else first + second
            case ast.ListComp(generators=[ast.comprehension(iter=iterated, ifs=[])]):
                match iterated:
                    case ast.Call(func=ast.Name(id="range"), args=[count]):
                        return self._whole(count)
            case ast.Call(func=ast.Attribute(value=array, attr="tolist"), args=[]):
                return self._array(array)
        return self._array(expression)

    def _array(self, expression: ast.expr) -> int | None:
        match expression:
            case ast.Call(func=made, args=[shape, *_]) if (
                dotted_name(made, self._module) in _FILLED
            ):
                return self._whole(shape)
        return None

    def _whole(self, expression: ast.expr) -> int | None:
        """The integer value of an expression of literals and constants."""
        match expression:
            case ast.Constant():
                return _small_int(expression)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() as op, right=right):
                one, other = self._whole(left), self._whole(right)
                if one is None or other is None:
                    return None
                if isinstance(op, ast.Mult):
                    number = one * other
                else:
                    number = one + other if isinstance(op, ast.Add) else one - other
                return number if abs(number) < _LONGEST else None
            case ast.Call(func=ast.Name(id="len"), args=[items]):
                return self._items(items)
            case ast.Attribute(value=owner, attr=name) if self._scope.is_self(owner):
                return self._class_constant(name)
            case ast.Name(id=name) if name in self._local:
                return None
            case ast.Name() | ast.Attribute():
                return self._constant(expression)
        return None

    def _constant(self, expression: ast.expr) -> int | None:
        dotted = dotted_name(expression, self._module) or ""
        definition = self._library.definition(dotted) if "." in dotted else None
        return _small_int(definition.node if definition else None)

    def _class_constant(self, name: str) -> int | None:
        """An int constant of the class body that no class reassigns."""
        values: list[ast.expr | None] = []
        for source in self._lineage.classes:
            for node in ast.walk(source.node):
                match node:
                    case ast.Attribute(attr=attribute, ctx=ast.Store() | ast.Del()):
                        values += [None] if attribute == name else []
                    case ast.Assign(targets=[ast.Name(id=bound)], value=value):
                        values += [value] if bound == name else []
                    case ast.AnnAssign(target=ast.Name(id=bound), value=value):
                        values += [value] if bound == name else []
        return _small_int(values[0]) if len(values) == 1 and self._lineage.is_whole else None


def _small_int(node: ast.AST | None) -> int | None:
    """The value of an int literal; None for other nodes, and for numbers that are too large."""
    match node:
        case ast.Constant(value=int(number)) if not isinstance(number, bool):
            return number if abs(number) < _LONGEST else None
    return None


def _extended(node: ast.AST) -> Iterator[tuple[str, str]]:
    """The message and field that a statement extends."""
    match node:
        case ast.Call(
            func=ast.Attribute(
                value=ast.Attribute(value=ast.Name(id=name), attr=field), attr=method
            )
        ) if method in _LONGER:
            yield name, field
        case ast.AugAssign(target=ast.Attribute(value=ast.Name(id=name), attr=field)):
            yield name, field
