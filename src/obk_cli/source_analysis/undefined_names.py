"""Names that a module uses and never binds, and attributes that a node never gets.

What cannot be seen whole, such as `import *`, `exec` or `setattr`, gives no finding.
"""

import ast
import builtins
from collections.abc import Iterable, Iterator

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, Severity, found
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.modules import Module, ModuleLibrary, span_of

__all__ = [
    "bound_names",
    "check_base_constructor",
    "check_callbacks",
    "check_names",
    "nodes_without_fallback",
    "what_import_runs",
]

_BIND_UNSEEN = ("exec", "globals", "locals", "vars", "setattr", "builtins", "__getattr__")
"""Names whose use can bind other names."""
_SETS_UNSEEN = (*_BIND_UNSEEN, "__dict__", "__getattribute__", "__setattr__", "update_wrapper")
_OTHER_RUNS = ("TYPE_CHECKING", "version_info", "hexversion", "PY2", "PY3", "platform", "hasattr")
"""Names in the test of an `if` for type checkers, other Pythons and other machines."""
_TYPE_PARAMETERS = ("TypeVar", "ParamSpec", "TypeVarTuple")
"""Syntax of Python 3.12, `class Filter[T]`."""
_ROS_NODE_MODULES = ("rclpy.node", "rclpy.lifecycle.node", "rclpy.lifecycle.managed_entity")


def bound_names(module: Module) -> frozenset[str] | None:
    """Every name that the module binds in any scope; None if some cannot be seen."""
    if module.has_more_names or _words(module.tree) & {*_BIND_UNSEEN}:
        return None
    return frozenset(_stored(module.tree))


def _stored(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                yield name
            case (
                ast.ClassDef(name=name)
                | ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
            ):
                yield name
            case ast.alias(name=name, asname=asname):
                yield asname or name.partition(".")[0]
            case ast.arg(arg=name) | ast.MatchMapping(rest=str(name)):
                yield name
            case ast.ExceptHandler(name=str(name)):
                yield name
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield name
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                yield from names
            case _ if type(node).__name__ in _TYPE_PARAMETERS:
                yield str(getattr(node, "name", ""))


def _words(tree: ast.AST) -> frozenset[str]:
    """Every name and attribute that is used."""
    return frozenset(
        node.id if isinstance(node, ast.Name) else node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Name | ast.Attribute)
    )


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
        elif isinstance(node, ast.If | ast.IfExp) and _words(node.test) & {*_OTHER_RUNS}:
            left_out.update(map(id, ast.iter_child_nodes(node)))
        children = [child for child in ast.iter_child_nodes(node) if id(child) not in left_out]
        pending += reversed(children)


def check_names(
    module: Module, trees: Iterable[ast.AST], severity: Severity = "error"
) -> Iterator[Diagnostic]:
    """OBK420: the first use, in code that runs, of each name that the module never binds."""
    bound = bound_names(module)
    if bound is None:
        return
    seen: set[str] = set()
    uses = (node for tree in trees for node in nodes_without_fallback(tree))
    for use in uses:
        if not isinstance(use, ast.Name) or use.id in bound or use.id in seen:
            continue
        if hasattr(builtins, use.id) or use.id.startswith("_"):
            continue
        seen.add(use.id)
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
    """OBK424: registered callbacks that are no attribute of the node."""
    known = _attributes(lineage, library)
    if known is None:
        return
    own = {m.name for c in lineage.classes if not c.is_of_library for m in c.methods()}
    for callback, module in callbacks:
        if callback.attr not in known:
            yield found(
                "OBK424",
                f"class `{lineage.classes[0].node.name}` has no method `{callback.attr}`",
                span_of(callback, module.source),
                help=ask_for(near_names(callback.attr, {*own} - {"__init__"}))
                or f"define `{callback.attr}`, or register another callback",
                related=(Related(message="the class", span=_class_span(lineage.classes[0])),),
            )


def _attributes(lineage: Lineage, library: ModuleLibrary) -> frozenset[str] | None:
    """Every attribute that the node may have; None if some cannot be seen."""
    if not lineage.is_whole:
        return None
    names: set[str] = set()
    for source in lineage.classes:
        tree = source.node if source.is_of_library else source.module.tree
        if source.node.keywords or (not source.is_of_library and _words(tree) & {*_SETS_UNSEEN}):
            return None
        names.update(_stored(source.node), _attributes_named(tree))
    for name in _ROS_NODE_MODULES:
        module = library.module(name)
        if module is not None:
            names.update(_stored(module.tree), _attributes_named(module.tree))
    return frozenset(names)


def _attributes_named(tree: ast.AST) -> Iterator[str]:
    """Attributes that are assigned, whatever the object."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def check_base_constructor(function: Function, source: ClassSource) -> Iterator[Diagnostic]:
    """OBK422: a constructor that leaves the node without its base class."""
    yield found(
        "OBK422",
        f"`{source.node.name}.__init__` does not call `super().__init__`",
        span_of(function, source.module.source),
        help="begin it with `super().__init__(node_name)`, which makes the ROS node",
    )


def _class_span(source: ClassSource) -> Span:
    return span_of(source.node, source.module.source)
