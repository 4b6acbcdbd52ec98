"""What an expression of a node's source is worth, as far as that can be seen without running it."""

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from obk_cli.code.modules import Library, Module, dotted_name

__all__ = ["UNKNOWN", "Dotted", "Environment", "Unknown", "Value", "message_type", "value_of"]


class Unknown(Enum):
    """The one mark for what is computed at run time."""

    UNKNOWN = "unknown"


UNKNOWN: Final = Unknown.UNKNOWN


@dataclass(frozen=True, slots=True)
class Dotted:
    """A class, function or module, by its full name."""

    name: str


Value = str | bool | None | Dotted | Unknown
Environment = Mapping[str, Value]
"""Local names, such as a constructor's parameters."""

_MESSAGE = re.compile(r"(\w+)\.msg\.(?:_\w+\.)?([A-Z]\w*)")


def message_type(value: Value) -> str | None:
    """The message type that a class stands for, `pkg/msg/Name`; None for anything else."""
    parts = _MESSAGE.fullmatch(value.name) if isinstance(value, Dotted) else None
    return f"{parts[1]}/msg/{parts[2]}" if parts else None


def value_of(
    expression: ast.expr | None, module: Module, library: Library, local: Environment
) -> Value:
    """The text, truth, None or class that an expression is; no expression counts as None."""
    match expression:
        case None:
            return None
        case ast.Constant(value=str() | bool() | None as constant):
            return constant
        case ast.Name(id=name) if name in local:
            return local[name]
        case ast.BoolOp(op=ast.Or(), values=[first, second]):
            value = value_of(first, module, library, local)
            if value is UNKNOWN:
                return UNKNOWN
            return value or value_of(second, module, library, local)
        case ast.Name() | ast.Attribute():
            return _named(expression, module, library)
        case _:
            return UNKNOWN


def _named(expression: ast.expr, module: Module, library: Library) -> Value:
    dotted = dotted_name(expression, module)
    if dotted is None or "." not in dotted:
        return UNKNOWN
    if _MESSAGE.fullmatch(dotted):
        return Dotted(dotted)
    found = library.definition(dotted)
    if found is None:
        return UNKNOWN
    if isinstance(found.node, ast.expr):
        match found.node:
            case ast.Constant(value=str() | bool() | None as constant):
                return constant
            case ast.Name() | ast.Attribute():
                further = dotted_name(found.node, found.module)
                return Dotted(further) if further and _MESSAGE.fullmatch(further) else UNKNOWN
        return UNKNOWN
    return Dotted(f"{found.module.name}.{found.node.name}")
