"""`ros_parameter: pub_ctrl_setting` into `key: pub_ctrl`, and back.

A component in, edits of its two names out. A name is left as it is where the other spelling would
not mean the same to every node: a `key` of another name beside it, a name without `_setting`, a
name that stands in several places.
"""

import re
from collections.abc import Iterator

from obelisk_spec.components import SETTING_SUFFIX, component_identity
from obk_cli.config.fixes import remove_entry, respell
from obk_cli.config.tree import Entry, TreeMap
from obk_cli.diagnostics.diagnostic import Diagnostic
from obk_cli.diagnostics.edits import Edit, Offsets
from obk_cli.migrate.kept import kept
from obk_cli.migrate.shape import Spelling, text_of

__all__ = ["rename_component"]

_NEW_NAME = {"key": "key", "seed": "ros_parameter"}
_OLD_NAME = {"key": "ros_parameter", "seed": "key"}


def rename_component(
    component: TreeMap, to: Spelling, offsets: Offsets
) -> Iterator[Edit | Diagnostic]:
    """The edits that name a component in that spelling, or why it keeps its name."""
    old, new = component.get(_OLD_NAME[to]), component.get(_NEW_NAME[to])
    name = text_of(old)
    if old is None or name is None or (to == "seed" and new is not None):
        return
    reason = _reason_to_keep(name, old, to, offsets)
    if reason is not None:
        yield kept(f"`{old.key}: {name}` stays: {reason}", old.value.span)
    elif new is None:
        yield from _renamed(old, name, to)
    elif component_identity(text_of(new) or "") == component_identity(name):
        yield from remove_entry(component, old)
    else:
        yield kept(
            f"`{old.key}: {name}` stays: the `key` beside it is another name, and nodes may look "
            "for either",
            old.value.span,
        )


def _reason_to_keep(name: str, entry: Entry, to: Spelling, offsets: Offsets) -> str | None:
    if "${" in name:
        return "what it comes to is known only with its variables"
    if to == "key" and (not name.endswith(SETTING_SUFFIX) or name == SETTING_SUFFIX):
        return f"a `key` stands for a parameter that ends in `{SETTING_SUFFIX}`"
    value = entry.value.span
    between = offsets.source.text[offsets.end(entry.key_span) : offsets.start(value)]
    if re.fullmatch(r"[ \t]*:\s*", between) is None or value.text[:1] in ("&", "!"):
        return "it stands in several places, by an anchor"
    if not respell(value, name, name):
        return "it is written with escapes or over several lines"
    return None


def _renamed(entry: Entry, name: str, to: Spelling) -> Iterator[Edit]:
    key = component_identity(name)
    value = key if to == "key" else f"{key}{SETTING_SUFFIX}"
    yield from respell(entry.key_span, entry.key, _NEW_NAME[to])
    yield from respell(entry.value.span, name, value)
