"""Find iteration over sets whose order depends on hashes.

Sets of numbers, whose order is the same in each process, do not count. An empty set that is filled
later counts if its annotation names other items.
"""

import ast
from collections.abc import Iterable, Iterator
from functools import lru_cache

from obk_cli.source_analysis.modules import words_in
from obk_cli.source_analysis.reached_code import CodeBlock

__all__ = ["ordered_by_hash"]

_SETS = ("set", "frozenset")
_TAKE_IN_ORDER = ("list", "tuple", "enumerate", "iter", "zip", "map", "filter")
_IGNORE_ORDER = ("sorted", "set", "frozenset", "min", "max", "any", "all", "len", "sum")
"""Calls whose result does not depend on the order, or only in the last bits (a sum)."""
_GIVE_SETS = ("union", "intersection", "difference", "symmetric_difference", "copy")
_GIVE_NUMBERS = ("int", "float", "bool", "round", "abs", "len", "ord", "range")
_NUMBERS = frozenset(("int", "float", "bool", "complex"))


def ordered_by_hash(block: CodeBlock) -> Iterator[ast.expr]:
    """Every set whose order affects what a block of code does."""
    sets = _Sets(block)
    harmless = {
        id(argument)
        for node in block.nodes
        if isinstance(node, ast.Call) and block.name_of(node.func) in _IGNORE_ORDER
        for argument in node.args
    }
    for node in block.nodes:
        if id(node) not in harmless:
            yield from (taken for taken in _taken(node, block) if sets.is_set(taken))


def _taken(node: ast.AST, block: CodeBlock) -> list[ast.expr]:
    """The expressions whose items a syntax node takes in order."""
    match node:
        case ast.For(iter=items) | ast.AsyncFor(iter=items):
            return [items]
        case ast.ListComp() | ast.DictComp() | ast.GeneratorExp():
            return [generator.iter for generator in node.generators]
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [item.value for item in items if isinstance(item, ast.Starred)]
        case ast.Call(func=ast.Attribute(value=ast.Constant(value=str()), attr="join"), args=args):
            return args
        case ast.Call(func=called, args=args) if block.name_of(called) in _TAKE_IN_ORDER:
            return args
    return []


class _Sets:
    """The sets of a block of code."""

    def __init__(self, block: CodeBlock) -> None:
        self._block = block

    def is_set(self, expression: ast.expr, *, follow_names: bool = True) -> bool:
        """Whether an expression is definitely a set, and not one of numbers."""
        match expression:
            case ast.Set(elts=items):
                return not all(map(_is_number, items))
            case ast.SetComp(elt=item):
                return not _is_number(item)
            case ast.Call(func=ast.Attribute(value=value, attr=method)) if method in _GIVE_SETS:
                return self.is_set(value, follow_names=follow_names)
            case ast.Call(func=called, args=[items]) if self._block.name_of(called) in _SETS:
                return not _are_numbers(items)
            case ast.BinOp(left=left, op=ast.BitOr() | ast.BitAnd() | ast.Sub(), right=right):
                return any(self.is_set(one, follow_names=follow_names) for one in (left, right))
            case ast.Name(id=name) if follow_names:
                nodes = self._block.nodes if self._block.has_scope else ()
                return self._is_bound_to_set(_bound_once(nodes).get(name))
            case ast.Attribute(value=ast.Name(id="self"), attr=attribute) if follow_names:
                owner = self._block.owner
                bindings = _bound_in_class(owner) if owner else {}
                return self._is_bound_to_set(bindings.get(f"self.{attribute}"))
        return False

    def _is_bound_to_set(self, binding: ast.Assign | ast.AnnAssign | None) -> bool:
        if binding is None or binding.value is None:
            return False
        if isinstance(binding, ast.AnnAssign):
            words = words_in(binding.annotation)
            if words & _NUMBERS:
                return False
            match binding.value:
                case ast.Call(func=ast.Name(id="set"), args=[]) if "set" in words:
                    return len(words) > 1
        return self.is_set(binding.value, follow_names=False)


_Bindings = dict[str, ast.Assign | ast.AnnAssign]


@lru_cache(maxsize=1)  # methods of one class are examined in sequence
def _bound_in_class(owner: ast.ClassDef) -> _Bindings:
    return _bound_once(ast.walk(owner))


def _bound_once(nodes: Iterable[ast.AST]) -> _Bindings:
    """`name` or `self.name` -> the only statement that binds it."""
    bindings: _Bindings = {}
    stores: dict[str, int] = {}
    for node in nodes:
        match node:
            case ast.Assign(targets=[target]) | ast.AnnAssign(target=target):
                bindings[_dotted(target)] = node
            case ast.Name(ctx=ast.Store()) | ast.Attribute(ctx=ast.Store()):
                name = _dotted(node)
                stores[name] = stores.get(name, 0) + 1
            case ast.arg(arg=name):
                stores[name] = stores.get(name, 0) + 1
    return {name: node for name, node in bindings.items() if stores.get(name) == 1}


def _dotted(target: ast.expr) -> str:
    match target:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=ast.Name(id=owner), attr=name):
            return f"{owner}.{name}"
    return ""


def _is_number(expression: ast.expr) -> bool:
    match expression:
        case ast.Constant(value=value):
            return not isinstance(value, str | bytes)
        case ast.UnaryOp(operand=operand):
            return _is_number(operand)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) and _is_number(right)
        case ast.Call(func=ast.Name(id=name)):
            return name in _GIVE_NUMBERS
    return False


def _are_numbers(items: ast.expr) -> bool:
    match items:
        case ast.List(elts=elements) | ast.Tuple(elts=elements) | ast.Set(elts=elements):
            return all(map(_is_number, elements))
        case ast.GeneratorExp(elt=element) | ast.ListComp(elt=element):
            return _is_number(element)
        case ast.Call(func=ast.Name(id="range")):
            return True
    return False
