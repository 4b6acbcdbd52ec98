"""OBK422: constructors and `on_configure` methods that do not run their base class's."""

import ast
from collections.abc import Iterator

from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.modules import span_of, words_in
from obk_cli.source_analysis.scope import mentions

__all__ = ["check_base_configure", "check_base_constructor", "has_no_way_to_base"]

_CONFIGURE = "on_configure"


def check_base_constructor(function: Function, source: ClassSource) -> Iterator[Diagnostic]:
    """Report a constructor that does not run its base class's constructor."""
    yield found(
        "OBK422",
        f"`{source.node.name}.__init__` does not call `super().__init__`",
        span_of(function, source.module.source),
        help="start it with `super().__init__(node_name)`, which creates the ROS node",
    )


def check_base_configure(lineage: Lineage) -> Iterator[Diagnostic]:
    """Find an `on_configure` that does not run the library's; the others need not."""
    reached = lineage.plain_method(_CONFIGURE)
    if reached is None or not lineage.is_whole:
        return
    source, function = reached
    own = [c for c in lineage.classes if not c.is_of_library]
    if any(c.node.keywords or _is_named_in(c.module.tree) for c in own):
        return  # a metaclass, a helper, or the `on_configure` of a base class, may run it
    if has_no_way_to_base(function, lineage):
        yield found(
            "OBK422",
            f"`{source.node.name}.{_CONFIGURE}` does not call `super().{_CONFIGURE}`",
            span_of(function, source.module.source),
            help=f"call `super().{_CONFIGURE}(state)`, which creates the node's components",
        )


def _is_named_in(tree: ast.AST) -> bool:
    """Whether code uses `on_configure`, also by its name as text."""
    texts = (n.value for n in ast.walk(tree) if isinstance(n, ast.Constant))
    return _CONFIGURE in words_in(tree) or _CONFIGURE in texts


def has_no_way_to_base(function: Function, lineage: Lineage) -> bool:
    """Whether a method that does not mention its own name has no other way to run its base's."""
    if function.decorator_list:
        return False
    self_name = next((a.arg for a in (*function.args.posonlyargs, *function.args.args)), "")
    attributes = [n for n in ast.walk(function) if isinstance(n, ast.Attribute)]
    owners = {id(attribute.value) for attribute in attributes}
    names = [n for n in ast.walk(function) if isinstance(n, ast.Name) and id(n) not in owners]
    if any(name.id in (self_name, "super", "exec", "eval") for name in names):
        return False
    reached = (lineage.method(attribute.attr) for attribute in attributes)
    return not any(found and mentions(found[1], function.name) for found in reached)
