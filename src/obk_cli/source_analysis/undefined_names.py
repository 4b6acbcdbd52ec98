"""Find names that a module uses but never binds.

Where `import *`, `exec` or the like may bind unknown names, nothing is reported.
"""

import ast
import builtins
from collections.abc import Iterable, Iterator

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.diagnostics.diagnostic import Diagnostic, Severity, found
from obk_cli.source_analysis.modules import Module, span_of, words_in

__all__ = ["check_names", "nodes_without_fallback", "what_import_runs"]

_OTHER_RUNS = ("TYPE_CHECKING", "version_info", "hexversion", "PY2", "PY3", "platform", "hasattr")
"""Names in `if` conditions for type checkers, other Python versions and other machines."""


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
    """The syntax below `tree` that runs on every machine and whose exceptions are not handled.

    Annotations are left out too.
    """
    pending = [tree]
    while pending:
        node = pending.pop()
        yield node
        left_out = {id(getattr(node, name, None)) for name in ("annotation", "returns")}
        if isinstance(node, ast.Try | ast.TryStar) and node.handlers:
            left_out.update(map(id, (*node.body, *node.handlers, *node.orelse)))
        elif isinstance(node, ast.With) and any("suppress" in words_in(i) for i in node.items):
            left_out.update(map(id, node.body))
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
