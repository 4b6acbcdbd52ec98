"""`${NAME}` and `${NAME:-text}` in string values. The environment comes in as a mapping."""

import re
from collections.abc import Mapping
from dataclasses import replace

from obelisk_spec.near import ask_for, near_names
from obelisk_spec.variables import REFERENCE, value_of_reference
from obelisk_spec.yaml_core import core_scalar
from obk_cli.diagnostics import Diagnostic, found
from obk_cli.source import Span
from obk_cli.tree import Tree, TreeList, TreeMap, TreeScalar

__all__ = ["resolve_variables"]

_MOST_SUGGESTIONS = 50
"""Findings with a near name; whoever has more is told the names only."""


def resolve_variables(
    tree: Tree, environment: Mapping[str, str]
) -> tuple[Tree, tuple[Diagnostic, ...]]:
    """The tree with every reference replaced; findings for those that nothing stands for.

    An unquoted value is read anew afterwards, so `${STEP:-0.001}` is a number.
    """
    faults: list[Diagnostic] = []
    return _replaced(tree, environment, faults), tuple(faults)


def _replaced(tree: Tree, environment: Mapping[str, str], faults: list[Diagnostic]) -> Tree:
    match tree:
        case TreeMap():
            entries = (
                replace(entry, value=_replaced(entry.value, environment, faults)) for entry in tree
            )
            return TreeMap(tuple(entries), tree.span)
        case TreeList():
            items = (_replaced(item, environment, faults) for item in tree.items)
            return TreeList(tuple(items), tree.span)
        case TreeScalar(value=str() as text) if "${" in text:
            return _replaced_text(text, tree.span, environment, faults)
    return tree


def _replaced_text(
    text: str, span: Span, environment: Mapping[str, str], faults: list[Diagnostic]
) -> TreeScalar:
    told: set[str] = set()
    places: dict[str, Span] = {}

    def value_of(reference: re.Match[str]) -> str:
        value = value_of_reference(reference, environment)
        if value is not None:
            return value
        if reference[0] not in told:
            told.add(reference[0])
            known = environment if len(faults) < _MOST_SUGGESTIONS else {}
            places.update({} if places else _first_places(span))
            faults.append(_undefined(reference[1], places.get(reference[0], span), known))
        return reference[0]

    new = REFERENCE.sub(value_of, text)
    is_plain = span.text[:1] not in ("'", '"', "|", ">")
    return TreeScalar(core_scalar(new) if is_plain else new, span, new)


def _first_places(span: Span) -> dict[str, Span]:
    """Reference -> where it stands first on the first line of a value."""
    places: dict[str, Span] = {}
    for match in REFERENCE.finditer(span.text):
        column = span.column + match.start()
        places.setdefault(match[0], Span.at(span.source, span.line, column, len(match[0])))
    return places


def _undefined(name: str | None, place: Span, environment: Mapping[str, str]) -> Diagnostic:
    if name is None:
        message = "`${` does not begin a `${NAME}`"
        return found("OBK011", message, place, help="write `$${` for a literal `${`")
    hint = ask_for(near_names(name, environment))
    default = f"write `${{{name}:-text}}` to give a default"
    return found(
        "OBK011",
        f"environment variable `{name}` is not set",
        place,
        help=f"{hint} or {default}" if hint else default,
    )
