"""Settings as a node gets them in a string ROS parameter: reading them and writing them.

Read: flow text `{topic: /x, history_depth: 10}` and the old flat form `topic:/x,history_depth:10`.
Written: always flow text. The values are those of YAML 1.2 core.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence

from obelisk_spec.yaml_core import YamlTextError, core_scalar, load_yaml_core

__all__ = ["SettingTextError", "format_setting", "parse_component_setting", "parse_mapping"]

_FLAT_FIELD = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_]*)\s*:(.*)", re.DOTALL)
_NEXT_FLAT_FIELD = re.compile(r",(?=\s*[A-Za-z_][A-Za-z0-9_]*\s*:)")
_PLAIN = re.compile(r"[A-Za-z/_~][A-Za-z0-9/_.~-]*")
_UNWRITABLE = re.compile("[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")


class SettingTextError(ValueError):
    """A settings text that is neither flow text nor the flat form; the message quotes it."""


def parse_component_setting(text: str) -> dict[str, object]:
    """The settings in a component's ROS parameter; empty text has none.

    Raises:
        SettingTextError: the text is in neither form.
    """
    if text.lstrip().startswith("{") or "\n" in text.strip():
        return parse_mapping(text)
    return dict(_flat_field(part, text) for part in _flat_parts(text))


def parse_mapping(text: str) -> dict[str, object]:
    """A YAML text that is one mapping with string keys (`obelisk_settings`, a `sim` block).

    Raises:
        SettingTextError: the text is not YAML or not such a mapping.
    """
    try:
        value = load_yaml_core(text)
    except YamlTextError as error:
        raise SettingTextError(f"settings text {text!r} is not YAML: {error}") from error
    if value is None:
        return {}
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise SettingTextError(f"settings text {text!r} is not a mapping like `{{topic: /x}}`")
    return value


def _flat_parts(text: str) -> list[str]:
    return _NEXT_FLAT_FIELD.split(text.strip().removesuffix(",")) if text.strip() else []


def _flat_field(part: str, text: str) -> tuple[str, object]:
    field = _FLAT_FIELD.fullmatch(part)
    if field is None:
        raise SettingTextError(
            f"settings text {text!r} is neither like `{{topic: /x, history_depth: 10}}` "
            "nor like `topic:/x,history_depth:10`"
        )
    return field[1], core_scalar(field[2].strip())


def format_setting(value: object) -> str:
    """Flow text that `parse_mapping` reads back to an equal value, on one line."""
    if isinstance(value, Mapping):
        fields = (f"{_format_str(str(key))}: {format_setting(item)}" for key, item in value.items())
        return f"{{{', '.join(fields)}}}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(format_setting, value))}]"
    return _format_str(value) if isinstance(value, str) else _format_scalar(value)


def _format_scalar(value: object) -> str:
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    return repr(value)


def _format_str(text: str) -> str:
    if _PLAIN.fullmatch(text) and isinstance(core_scalar(text), str):
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    return _UNWRITABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", quoted)
