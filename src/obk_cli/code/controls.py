"""How many controls a node's source writes into its control messages, where that is written out."""

import ast
from collections.abc import Iterator

from obk_cli.code.lineage import ClassSource, Function, Lineage
from obk_cli.code.modules import Library, span_of
from obk_cli.code.values import message_type, value_of
from obk_cli.node_code import ControlLength

__all__ = ["control_lengths"]

_FIELDS = ("u_mujoco", "u")
_PACKAGE = "obelisk_control_msgs/"


def control_lengths(lineage: Lineage, library: Library) -> Iterator[ControlLength]:
    """Every `message.u_mujoco = [...]` with a list of known length."""
    for source in lineage.classes:
        if not source.is_of_library:
            for method in source.methods():
                yield from _in_method(method, source, library)


def _in_method(method: Function, source: ClassSource, library: Library) -> Iterator[ControlLength]:
    messages: set[str] = set()
    for node in ast.walk(method):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call(func=made)):
                made_type = message_type(value_of(made, source.module, library, {})) or ""
                if made_type.startswith(_PACKAGE):
                    messages.add(name)
    for node in ast.walk(method):
        match node:
            case ast.Assign(
                targets=[ast.Attribute(value=ast.Name(id=name), attr=field)],
                value=ast.List(elts=values) | ast.Tuple(elts=values),
            ) if field in _FIELDS and name in messages:
                # An empty list is filled by what follows.
                if values and not any(isinstance(value, ast.Starred) for value in values):
                    span = span_of(node, source.module.source)
                    yield ControlLength(field=field, length=len(values), span=span)
