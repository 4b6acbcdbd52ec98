"""Find names that a module uses but never binds, and attributes that a node never gets.

Where `import *`, `exec`, `setattr` or the like may bind unknown names, nothing is reported.
"""

import ast
import builtins
from collections.abc import Iterable, Iterator

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, Severity, found
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.modules import (
    BIND_UNSEEN,
    Module,
    ModuleLibrary,
    at_top_level,
    span_of,
    stored_names,
    words_in,
)

__all__ = [
    "check_base_constructor",
    "check_callbacks",
    "check_names",
    "nodes_without_fallback",
    "what_import_runs",
]

_SETS_UNSEEN = (
    *BIND_UNSEEN,
    "setattr",
    "__dict__",
    "__getattribute__",
    "__setattr__",
    "update_wrapper",
)
_OTHER_RUNS = ("TYPE_CHECKING", "version_info", "hexversion", "PY2", "PY3", "platform", "hasattr")
"""Names in `if` conditions for type checkers, other Python versions and other machines."""
_ROS_NODE_MODULES = ("rclpy.node", "rclpy.lifecycle.node", "rclpy.lifecycle.managed_entity")


def what_import_runs(module: Module) -> Iterator[ast.AST]:
    """The statements, decorators and base classes that run when the module is imported."""
    pending: list[ast.AST] = list(reversed(module.tree.body))
    while pending:
        node = pending.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from node.decorator_list
        elif isinstance(node, ast.ClassDef):
            yield from (*node.decorator_list, *node.bases)
            pending += reversed(node.body)
        else:
            yield node


def nodes_without_fallback(tree: ast.AST) -> Iterator[ast.AST]:
    """The syntax below `tree` that runs on every machine; no `try` with handlers, no annotation."""
    pending = [tree]
    while pending:
        node = pending.pop()
        yield node
        left_out = {id(getattr(node, name, None)) for name in ("annotation", "returns")}
        if isinstance(node, ast.Try | ast.TryStar) and node.handlers:
            left_out.update(map(id, (*node.body, *node.handlers, *node.orelse)))
        elif isinstance(node, ast.If | ast.IfExp) and words_in(node.test) & {*_OTHER_RUNS}:
            left_out.update(map(id, ast.iter_child_nodes(node)))
        children = [child for child in ast.iter_child_nodes(node) if id(child) not in left_out]
        pending += reversed(children)


def check_names(
    module: Module,
    trees: Iterable[ast.AST],
    reported: Iterable[str] = (),
    severity: Severity = "error",
) -> Iterator[Diagnostic]:
    """OBK420: the first use, in code that runs, of each name that the module never binds.

    Args:
        module: the module.
        trees: its syntax that runs.
        reported: misspelled names that already have findings; the names that they mean are skipped.
        severity: the severity of the findings.
    """
    bound = module.bound_names
    if bound is None:
        return
    seen: set[str] = set()
    misspelt = tuple(reported)
    uses = (node for tree in trees for node in nodes_without_fallback(tree))
    for use in uses:
        if not isinstance(use, ast.Name) or use.id in bound or use.id in seen:
            continue
        if hasattr(builtins, use.id) or use.id.startswith("_"):
            continue
        seen.add(use.id)
        if near_names(use.id, misspelt):
            continue
        classes = [n.name for n in module.tree.body if isinstance(n, ast.ClassDef)]
        near = near_names(use.id, classes) or near_names(use.id, bound)
        is_class = use.id[0].isupper() and classes
        yield found(
            "OBK420",
            f"`{use.id}` is not defined in this module",
            span_of(use, module.source),
            help=ask_for(near)
            or (f"this module defines {list_names(classes)}" if is_class else None)
            or "import it, or correct the name",
            severity=severity,
        )


def check_callbacks(
    callbacks: Iterable[tuple[ast.Attribute, Module]], lineage: Lineage, library: ModuleLibrary
) -> Iterator[Diagnostic]:
    """OBK424: registered callbacks that are not attributes of the node."""
    unknown = [c for c in callbacks if lineage.method(c[0].attr) is None]
    known = _attributes(lineage) if unknown else None
    unknown = [c for c in unknown if known is not None and c[0].attr not in known]
    if not unknown:
        return
    of_ros = frozenset(name for m in _ROS_NODE_MODULES for name in _defined_in(library.module(m)))
    own = {m.name for c in lineage.classes if not c.is_of_library for m in c.methods()}
    for callback, module in unknown:
        if callback.attr not in of_ros:
            yield found(
                "OBK424",
                f"class `{lineage.classes[0].node.name}` has no method `{callback.attr}`",
                span_of(callback, module.source),
                help=ask_for(near_names(callback.attr, {*own} - {"__init__"}))
                or f"define `{callback.attr}`, or register another callback",
                related=(Related(message="the class", span=_class_span(lineage.classes[0])),),
            )


def _attributes(lineage: Lineage) -> frozenset[str] | None:
    """Every attribute that the classes may give the node; None if some are unknown."""
    if not lineage.is_whole:
        return None
    names: set[str] = set()
    for source in lineage.classes:
        tree = source.node if source.is_of_library else source.module.tree
        used = words_in(tree) | {method.name for method in source.methods()}
        if source.node.keywords or (not source.is_of_library and used & {*_SETS_UNSEEN}):
            return None
        names.update(_defined_in_class(source.node), _attributes_named(tree))
    return frozenset(names)


def _defined_in(module: Module | None) -> Iterator[str]:
    if module is not None:
        yield from stored_names(module.tree)
        yield from _attributes_named(module.tree)


def _defined_in_class(node: ast.ClassDef) -> Iterator[str]:
    for statement in at_top_level(node.body):
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield statement.name
        else:
            yield from stored_names(statement)


def _attributes_named(tree: ast.AST) -> Iterator[str]:
    """Attributes that are assigned on any object."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def check_base_constructor(function: Function, source: ClassSource) -> Iterator[Diagnostic]:
    """OBK422: a constructor that does not run its base class's constructor."""
    yield found(
        "OBK422",
        f"`{source.node.name}.__init__` does not call `super().__init__`",
        span_of(function, source.module.source),
        help="start it with `super().__init__(node_name)`, which creates the ROS node",
    )


def _class_span(source: ClassSource) -> Span:
    return span_of(source.node, source.module.source)
