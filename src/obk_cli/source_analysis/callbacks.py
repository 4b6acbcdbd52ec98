"""Check the callbacks that a node registers: each exists and takes the arguments that it is given.

Where `setattr`, `exec` or the like may replace attributes of the node, nothing is reported.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.config.environment import CodeComponent
from obk_cli.config.model import ComponentKind
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.source_analysis.class_hierarchy import Lineage
from obk_cli.source_analysis.modules import (
    BIND_UNSEEN,
    Module,
    ModuleLibrary,
    span_of,
    stored_names,
    words_in,
)
from obk_cli.source_analysis.scope import Scope

__all__ = ["check_arguments", "check_callbacks"]

_SETS_UNSEEN = (
    *BIND_UNSEEN,
    "setattr",
    "__dict__",
    "__getattribute__",
    "__setattr__",
    "update_wrapper",
)
_ROS_NODE_MODULES = ("rclpy.node", "rclpy.lifecycle.node", "rclpy.lifecycle.managed_entity")


@dataclass(frozen=True, slots=True)
class _Passed:
    """The positional arguments that a component passes to its callback."""

    counts: tuple[int, ...]
    names: tuple[str, ...]
    text: str
    creator: str
    """The method that receives the callback; a node's own one may wrap it."""


_PASSED: Final[Mapping[ComponentKind, _Passed]] = {
    # rclpy also passes the `MessageInfo` to a callback that takes two arguments.
    "subscriber": _Passed((1, 2), ("msg",), "with the message", "create_subscription"),
    "timer": _Passed((0,), (), "without arguments", "create_timer"),
}


def check_callbacks(
    callbacks: Iterable[tuple[ast.Attribute, Module]], lineage: Lineage, library: ModuleLibrary
) -> Iterator[Diagnostic]:
    """OBK424: registered callbacks that are not attributes of the node."""
    unknown = [c for c in callbacks if lineage.method(c[0].attr) is None]
    assigned = _assigned(lineage) if unknown else None
    if assigned is None:
        return
    known = assigned.union(*(c.defined_names for c in lineage.classes))
    unknown = [c for c in unknown if c[0].attr not in known]
    if not unknown:
        return
    of_ros = frozenset(name for m in _ROS_NODE_MODULES for name in _defined_in(library.module(m)))
    own = {m.name for c in lineage.classes if not c.is_of_library for m in c.methods()}
    first = lineage.classes[0]
    for callback, module in unknown:
        if callback.attr not in of_ros:
            yield found(
                "OBK424",
                f"class `{first.node.name}` has no method `{callback.attr}`",
                span_of(callback, module.source),
                help=ask_for(near_names(callback.attr, {*own} - {"__init__"}))
                or f"define `{callback.attr}`, or register another callback",
                related=(
                    Related(message="the class", span=span_of(first.node, first.module.source)),
                ),
            )


def check_arguments(
    callback: ast.expr | None, component: CodeComponent, scope: Scope, lineage: Lineage
) -> Diagnostic | None:
    """OBK428: a callback that cannot be called with the arguments that its component passes.

    Only lambdas, and methods that nothing can replace, are checked.

    Args:
        callback: the expression in the registration; None for a publisher.
        component: the registered component.
        scope: the scope of the registration.
        lineage: the node's class.
    """
    passed = _PASSED.get(component.kind)
    own = [c for c in lineage.classes if not c.is_of_library]
    if passed is None or any(c.has(passed.creator) for c in own):
        return None
    match callback:
        case ast.Lambda(args=arguments):
            if any(_accepts(arguments, count) for count in passed.counts):
                return None
            return found(
                "OBK428",
                f"the {component.kind} `{component.name}` calls its lambda {passed.text}, but it "
                f"{_requirement(arguments, 0)}",
                span_of(callback, scope.module.source),
                help=f"write `{' '.join(('lambda', *passed.names))}: ...`",
            )
        case ast.Attribute(value=owner, attr=name) if scope.is_self(owner):
            reached = lineage.plain_method(name)
            if reached is None:
                return None
            source, method = reached
            if any(_accepts(method.args, count + 1) for count in passed.counts):
                return None
            assigned = _assigned(lineage)
            if assigned is None or name in assigned:
                return None
            return found(
                "OBK428",
                f"the {component.kind} `{component.name}` calls `{source.node.name}.{name}` "
                f"{passed.text}, but it {_requirement(method.args, 1)}",
                span_of(method, source.module.source),
                help=f"write `def {name}({', '.join(('self', *passed.names))})`",
                related=(Related(message="registered here", span=component.span),),
            )
    return None


def _accepts(arguments: ast.arguments, count: int) -> bool:
    """Whether a function can be called with this number of positional arguments."""
    positional = len(arguments.posonlyargs) + len(arguments.args)
    return (
        count >= positional - len(arguments.defaults)
        and (count <= positional or arguments.vararg is not None)
        and None not in arguments.kw_defaults
    )


def _requirement(arguments: ast.arguments, of_self: int) -> str:
    """Which arguments a function takes that does not accept those of its component."""
    positional = [a.arg for a in (*arguments.posonlyargs, *arguments.args)]
    if len(positional) < of_self:
        return "does not take `self`"
    required = positional[of_self : len(positional) - len(arguments.defaults)]
    defaults = zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    required += [argument.arg for argument, default in defaults if default is None]
    return f"requires {list_names(required)}" if required else "takes no arguments"


def _assigned(lineage: Lineage) -> frozenset[str] | None:
    """Attributes that code may assign to the node; None if some are unknown."""
    if not lineage.is_whole:
        return None
    names: set[str] = set()
    for source in lineage.classes:
        tree = source.node if source.is_of_library else source.module.tree
        used = words_in(tree) | {method.name for method in source.methods()}
        if source.node.keywords or (not source.is_of_library and used & {*_SETS_UNSEEN}):
            return None
        names.update(_attributes_named(tree))
    return frozenset(names)


def _defined_in(module: Module | None) -> Iterator[str]:
    if module is not None:
        yield from stored_names(module.tree)
        yield from _attributes_named(module.tree)


def _attributes_named(tree: ast.AST) -> Iterator[str]:
    """Attributes that are assigned on any object."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr
