"""A node's entry as YAML text in the layout of the config that it goes into.

Plain values and a style in; lines, or one line in braces, out.
"""

import json
import re
from collections.abc import Iterator, Mapping
from decimal import Decimal

from obelisk_spec.components import SETTING_SUFFIX
from obelisk_spec.yaml_core import core_scalar
from obk_cli.config.model import COMPONENT_LISTS
from obk_cli.joining.newcomer import identity_of
from obk_cli.joining.style import Style

__all__ = ["block_lines", "flow_text", "list_lines", "named_as"]

_PLAIN = re.compile(r"[A-Za-z_/~][A-Za-z0-9_./~-]*")


def named_as(style: Style, entry: Mapping[str, object]) -> dict[str, object]:
    """The entry with its components named by `key` or by `ros_parameter`, as the style is."""
    return {
        key: [_renamed(item, style) for item in value]
        if key in COMPONENT_LISTS and isinstance(value, list)
        else value
        for key, value in entry.items()
    }


def list_lines(entry: Mapping[str, object], style: Style, indent: int) -> list[str]:
    """The entry as an item of a block list whose dash is at `indent`."""
    first, *rest = block_lines(entry, style)
    margin, body = " " * indent, " " * (1 + style.gap)
    return [f"{margin}-{' ' * style.gap}{first}", *(f"{margin}{body}{line}" for line in rest)]


def block_lines(entry: Mapping[str, object], style: Style) -> list[str]:
    """The entry as a block mapping at the left margin."""
    return list(_block(entry, style))


def flow_text(value: object) -> str:
    """A value within braces."""
    if isinstance(value, Mapping):
        inside = (f"{key}: {flow_text(item)}" for key, item in value.items())
        return f"{{{', '.join(inside)}}}"
    if isinstance(value, list):
        return f"[{', '.join(flow_text(item) for item in value)}]"
    return _scalar(value)


def _renamed(component: Mapping[str, object], style: Style) -> dict[str, object]:
    identity = identity_of(component)
    name = identity if style.naming == "key" else f"{identity}{SETTING_SUFFIX}"
    rest = {k: v for k, v in component.items() if k not in ("ros_parameter", "key")}
    return {style.naming: name, **rest}


def _block(mapping: Mapping[str, object], style: Style) -> Iterator[str]:
    for key, value in mapping.items():
        if isinstance(value, Mapping) and value:
            yield f"{key}:"
            yield from (f"{' ' * style.step}{line}" for line in _block(value, style))
        elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            yield f"{key}:"
            for item in value:
                yield from _item(item, style)
        else:
            yield f"{key}: {flow_text(value)}"


def _item(item: object, style: Style) -> Iterator[str]:
    if isinstance(item, Mapping) and not style.flow_components:
        yield from list_lines(item, style, style.dash)
    else:
        yield f"{' ' * style.dash}-{' ' * style.gap}{flow_text(item)}"


def _scalar(value: object) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case float() if "e" in repr(value):
            return f"{Decimal(repr(value)):f}"
        case int() | float():
            return repr(value)
    text = str(value)
    is_plain = _PLAIN.fullmatch(text) is not None and core_scalar(text) == text
    return text if is_plain else json.dumps(text, ensure_ascii=False)
