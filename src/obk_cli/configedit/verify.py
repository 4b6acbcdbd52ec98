"""Verify an edited config: its content is as expected, and it has no new errors.

Pure: trees and findings in; plain values to compare, and the new errors, out.
"""

from collections import Counter
from collections.abc import Iterable, Mapping

from obk_cli.config.tree import Tree, TreeMap, plain_value
from obk_cli.configedit.block_editor import Place
from obk_cli.diagnostics.diagnostic import Diagnostic

__all__ = ["content_of", "expected_content", "new_errors"]


def new_errors(before: Iterable[Diagnostic], after: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The errors that there are more of than before; line numbers and counted names may differ."""
    old = [finding for finding in before if finding.severity == "error"]
    told = {(finding.code, finding.message) for finding in old}
    errors = [finding for finding in after if finding.severity == "error"]
    more = Counter(f.code for f in errors) - Counter(f.code for f in old)
    return tuple(f for f in errors if f.code in more and (f.code, f.message) not in told)


def expected_content(
    tree: TreeMap, place: Place, entry: Mapping[str, object], index: int | None
) -> object:
    """What a text is to say: what it says in `tree`, and the node as the last or at `index`."""
    plain = plain_value(tree)
    holder = _holder(plain, place)
    nodes = _nodes(holder.get(place.section))
    if index is None:
        nodes.append(dict(entry))
    else:
        nodes[index] = dict(entry)
    holder[place.section] = nodes
    return plain


def content_of(tree: Tree, place: Place) -> object:
    """What a text says, the section of the place as a list."""
    plain = plain_value(tree)
    holder = _holder(plain, place)
    holder[place.section] = _nodes(holder.get(place.section))
    return plain


def _holder(plain: object, place: Place) -> dict[str, object]:
    assert isinstance(plain, dict)  # a config is a mapping
    key = place.device.key if place.device else place.new_device
    holder = plain.setdefault(key, {}) if key else plain
    assert isinstance(holder, dict)
    return holder


def _nodes(value: object) -> list[object]:
    if isinstance(value, list):
        return list(value)
    return [] if value is None else [value]
