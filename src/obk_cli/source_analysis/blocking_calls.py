"""Find callbacks that wait for something that only their own executor can deliver."""

import ast
from collections.abc import Iterable, Iterator, Sequence

from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.modules import dotted_name, span_of

__all__ = ["check_blocking_calls"]

_SPINS = ("rclpy.spin", "rclpy.spin_once", "rclpy.spin_until_future_complete")
_TAKE_CALLBACKS = (
    "create_",
    "register_obk_",
    "add_done_callback",
    "add_on_set_",
    "add_pre_set_",
    "add_post_set_",
)
"""Prefixes of methods that take a callback, which runs on the executor's thread."""
_OWN_THREAD = "run_simulator"
_CONSTRUCTOR = "__init__"


def check_blocking_calls(lineage: Lineage) -> Iterator[Diagnostic]:
    """OBK426: service calls that a callback waits for, and executors that a callback spins.

    `lineage` belongs to a node that the library's own single-threaded executor spins.
    """
    sources = [source for source in lineage.classes if not source.is_of_library]
    texts = {source.module.source.text for source in sources}
    if not any(".call(" in text or "spin_" in text or ".spin(" in text for text in texts):
        return  # the usual case
    callbacks = _reached({*_library_methods(lineage), *_passed(sources)}, lineage)
    clients = _clients(sources)
    for name in sorted({*callbacks, *_reached({_CONSTRUCTOR}, lineage)}):
        found_method = lineage.method(name)
        source = lineage.classes[found_method[0]] if found_method else None
        if found_method is None or source is None or source.is_of_library:
            continue
        for node in _own_nodes(found_method[1]):
            if isinstance(node, ast.Call):
                # A constructor may spin the node, because no executor runs it yet.
                yield from _waits(node, found_method[1], source, clients, name in callbacks)


def _library_methods(lineage: Lineage) -> Iterator[str]:
    """Methods that the base classes call on the executor's thread."""
    for source in lineage.classes:
        if source.is_of_library:
            names = {method.name for method in source.methods()}
            yield from names - {_OWN_THREAD, _CONSTRUCTOR}


def _passed(sources: Iterable[ClassSource]) -> Iterator[str]:
    """Methods that are passed as callbacks."""
    for source in sources:
        for method in source.methods():
            for node in ast.walk(method):
                match node:
                    case ast.Call(func=ast.Attribute(attr=taker)) if taker.startswith(
                        _TAKE_CALLBACKS
                    ):
                        given = [*node.args, *(keyword.value for keyword in node.keywords)]
                        names = (_own_attribute(argument, method) for argument in given)
                        yield from (name for name in names if name is not None)


def _reached(names: set[str], lineage: Lineage) -> set[str]:
    """The methods of the user's classes that the named methods call, directly or indirectly."""
    reached: set[str] = set()
    pending = sorted(names)
    while pending:
        name = pending.pop()
        method = lineage.method(name)
        if name in reached or method is None or lineage.classes[method[0]].is_of_library:
            continue
        reached.add(name)
        for node in _own_nodes(method[1]):
            called = _own_attribute(node.func, method[1]) if isinstance(node, ast.Call) else None
            pending += [called] if called is not None else []
    return reached


def _own_nodes(method: Function) -> Iterator[ast.AST]:
    """The syntax nodes in a method's body, without those in nested functions."""
    pending: list[ast.AST] = list(method.body)
    while pending:
        node = pending.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            pending += ast.iter_child_nodes(node)


def _clients(sources: Sequence[ClassSource]) -> frozenset[str]:
    """The attributes that only ever hold service clients."""
    made: set[str] = set()
    other: set[str] = set()
    for source in sources:
        for node in ast.walk(source.node):
            match node:
                case (
                    ast.Assign(targets=[ast.Attribute(attr=name)], value=value)
                    | ast.AnnAssign(target=ast.Attribute(attr=name), value=value)
                ):
                    (made if _is_client(value) else other).add(name)
    return frozenset(made - other)


def _is_client(value: ast.expr | None) -> bool:
    match value:
        case ast.Call(func=ast.Attribute(value=ast.Name(), attr="create_client")):
            return True
    return False


def _waits(
    call: ast.Call,
    method: Function,
    source: ClassSource,
    clients: frozenset[str],
    is_callback: bool,
) -> Iterator[Diagnostic]:
    match call.func:
        case ast.Attribute(value=client, attr="call"):
            is_known = _own_attribute(client, method) in clients
            if is_known or _is_client(client) or _is_local_client(client, method):
                yield _finding(
                    call,
                    method,
                    source,
                    "waits for a response that cannot arrive until the callback returns",
                )
        case ast.Attribute(value=owner, attr=spin) if spin.startswith("spin") and (
            _own_attribute(owner, method) == "executor"
        ):
            if is_callback:
                yield _finding(call, method, source, "spins the executor that runs it")
        case called if is_callback and dotted_name(called, source.module) in _SPINS:
            if call.args and _is_self(call.args[0], method):
                yield _finding(
                    call, method, source, "takes the node from the executor that runs it"
                )


def _finding(call: ast.Call, method: Function, source: ClassSource, what: str) -> Diagnostic:
    return found(
        "OBK426",
        f"`{ast.unparse(call.func)}` in `{method.name}` {what}",
        span_of(call, source.module.source),
        help="use `call_async` with a done callback, or `await` its future in an `async` callback",
    )


def _is_local_client(expression: ast.expr, method: Function) -> bool:
    if not isinstance(expression, ast.Name):
        return False
    values = [
        node.value
        for node in _own_nodes(method)
        if isinstance(node, ast.Assign)
        and any(isinstance(t, ast.Name) and t.id == expression.id for t in node.targets)
    ]
    return bool(values) and all(map(_is_client, values))


def _is_self(expression: ast.expr, method: Function) -> bool:
    arguments = [*method.args.posonlyargs, *method.args.args]
    return (
        isinstance(expression, ast.Name) and bool(arguments) and (expression.id == arguments[0].arg)
    )


def _own_attribute(expression: ast.expr, method: Function) -> str | None:
    """`x` of `self.x`; None for anything else."""
    match expression:
        case ast.Attribute(value=owner, attr=name) if _is_self(owner, method):
            return name
    return None
