"""`${NAME}` and `${NAME:-text}` in string values. The environment comes in as a mapping."""

import re
from collections.abc import Mapping
from dataclasses import replace

from obelisk_spec.suggestions import ask_for, near_names
from obelisk_spec.yaml_core import REFERENCE, core_scalar, value_of_reference
from obk_cli.config.tree import Tree, TreeList, TreeMap, TreeScalar
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.source import LONGEST_FILE_BYTES, Span

__all__ = ["resolve_variables"]

_MOST_SUGGESTIONS = 50
"""Findings with a near name; whoever has more is told the names only."""


def resolve_variables(
    tree: Tree, environment: Mapping[str, str]
) -> tuple[Tree, tuple[Diagnostic, ...]]:
    """The tree with every reference replaced; findings for those that nothing stands for.

    An unquoted value is read anew afterwards, so `${STEP:-0.001}` is a number.
    """
    replacer = _Replacer(environment)
    return replacer.tree(tree), tuple(replacer.faults)


class _Replacer:
    """Replaces references, and takes note of faults and of how long all texts have become."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.faults: list[Diagnostic] = []
        self._environment = environment
        self._room = LONGEST_FILE_BYTES

    def tree(self, tree: Tree) -> Tree:
        """The tree with every reference replaced, as long as there is room."""
        match tree:
            case TreeMap():
                entries = (replace(entry, value=self.tree(entry.value)) for entry in tree)
                return TreeMap(tuple(entries), tree.span)
            case TreeList():
                return TreeList(tuple(map(self.tree, tree.items)), tree.span)
            case TreeScalar(value=str() as text) if "${" in text and self._room >= 0:
                return self._text(text, tree.span)
        return tree

    def _text(self, text: str, span: Span) -> TreeScalar:
        told: set[str] = set()
        places: dict[str, Span] = {}
        # An alias stands for a text as often as it is written, a variable for one of any length.
        self._room -= len(text)

        def value_of(reference: re.Match[str]) -> str:
            value = value_of_reference(reference, self._environment)
            if value is not None:
                self._room -= len(value)
                return value if self._room >= 0 else ""
            if reference[0] not in told:
                told.add(reference[0])
                known = self._environment if len(self.faults) < _MOST_SUGGESTIONS else {}
                places.update({} if places else _first_places(span))
                place = places.get(reference[0], span)
                self.faults.append(_undefined(reference[1], place, known))
            return reference[0]

        new = REFERENCE.sub(value_of, text)
        if self._room < 0:
            message = "the texts that variables make are longer than 10 MiB together"
            self.faults.append(found("OBK007", message, span))
            return TreeScalar(text, span)
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
