"""Names of a config's components, and their settings in the form that nodes receive.

The ROS parameter `pub_ctrl_setting` and the key `pub_ctrl` name the same component; old configs
also use `publisher_ctrl`. Settings are a string in one of two forms. Nodes of every generation read
flat text, `topic:/x,history_depth:10`. JSON, `{"topic": "/x", "qos": {"depth": 1}}`, is for
settings that flat text cannot represent; any other YAML is read too. Values follow the YAML 1.2
core schema.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from obelisk_spec.yaml_core import YamlTextError, core_scalar, load_yaml_core, quoted_scalar

__all__ = [
    "CALLBACK_GROUPS_PARAMETER",
    "CALLBACK_GROUP_TYPES",
    "CONTROL_SUBSCRIPTION",
    "DEFAULT_HISTORY_DEPTH",
    "DEFAULT_STALE_ACTION",
    "ESTIMATE_SUBSCRIPTION",
    "SETTINGS_PARAMETER",
    "SETTING_SUFFIX",
    "STALE_ACTIONS",
    "STANDARD_COMPONENTS",
    "TIERS",
    "SettingTextError",
    "component_identity",
    "component_spellings",
    "format_component_setting",
    "format_setting",
    "parse_component_setting",
    "parse_mapping",
    "standard_component",
]

TIERS: Final = ("robot", "sensing", "estimation", "control", "viz", "joystick")
"""Sections that contain nodes, in bring-up order: publishers activate before subscribers."""

SETTING_SUFFIX: Final = "_setting"
DEFAULT_HISTORY_DEPTH: Final = 10

SETTINGS_PARAMETER: Final = "obelisk_settings"
"""The ROS parameter with the settings of all components and callback groups."""
CALLBACK_GROUPS_PARAMETER: Final = "callback_group_settings"
"""The ROS parameter with only the callback groups, as flat text, for existing nodes."""

CALLBACK_GROUP_TYPES: Final = ("MutuallyExclusiveCallbackGroup", "ReentrantCallbackGroup")

CONTROL_SUBSCRIPTION: Final = "sub_ctrl"
"""The component that receives a robot's commands; `max_age_sec` is one of its settings."""

ESTIMATE_SUBSCRIPTION: Final = "sub_est"
"""The component that receives a controller's estimate of the state."""

STALE_ACTIONS: Final = ("zero", "hold", "damp")
"""The robot's possible responses to a stale command."""
DEFAULT_STALE_ACTION: Final = "zero"

STANDARD_COMPONENTS: Final = (
    "pub_ctrl",
    ESTIMATE_SUBSCRIPTION,
    "timer_ctrl",
    "pub_est",
    "timer_est",
    CONTROL_SUBSCRIPTION,
    "pub_true_sim_state",
    "timer_true_sim_state",
)
"""Keys of the components that the base classes register."""

_LONG_PREFIXES: Final = (("pub_", "publisher_"), ("sub_", "subscriber_"))


def component_identity(name: str) -> str:
    """Return the plain key for a `ros_parameter` or `key`: `pub_ctrl_setting` -> `pub_ctrl`."""
    return name.removesuffix(SETTING_SUFFIX)


def component_spellings(name: str) -> tuple[str, ...]:
    """Return every spelling of a component's name, the plain key first.

    `pub_ctrl_setting` -> `pub_ctrl`, `pub_ctrl_setting`, `publisher_ctrl`,
    `publisher_ctrl_setting`; a name with another prefix has two spellings.
    """
    key = component_identity(name)
    keys = [key]
    for short, long in _LONG_PREFIXES:
        if key.startswith(short):
            keys.append(long + key.removeprefix(short))
        elif key.startswith(long):
            keys.append(short + key.removeprefix(long))
    return tuple(spelling for k in keys for spelling in (k, k + SETTING_SUFFIX))


def standard_component(name: str) -> str | None:
    """Return the base class component for any spelling; None for a custom component."""
    return next((key for key in STANDARD_COMPONENTS if name in component_spellings(key)), None)


_FLAT_FIELD = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_]*)\s*:(.*)", re.DOTALL)
_NEXT_FLAT_FIELD = re.compile(r",(?=\s*[A-Za-z_][A-Za-z0-9_]*\s*:)")
_FLAT_NAME = re.compile("[A-Za-z_][A-Za-z0-9_]*")
_FLAT_TEXT = re.compile(r"[^,:\s\x00-\x1f\x7f-\x9f]+")


class SettingTextError(ValueError):
    """Settings text is neither YAML nor flat text; the message quotes it."""


def parse_component_setting(text: str) -> dict[str, object]:
    """Parse the settings in a component's ROS parameter; an empty string has none.

    Raises:
        SettingTextError: the text is in neither form.
    """
    if text.lstrip().startswith("{") or "\n" in text.strip():
        return parse_mapping(text)
    return dict(_flat_field(part, text) for part in _flat_parts(text))


def parse_mapping(text: str) -> dict[str, object]:
    """Parse YAML text that is a single mapping with string keys (`obelisk_settings`, `sim` block).

    Raises:
        SettingTextError: the text is not valid YAML or not such a mapping.
    """
    try:
        value = _load_yaml(text)
    except YamlTextError as error:
        raise SettingTextError(f"settings text {text!r} is not valid YAML: {error}") from error
    if value is None:
        return {}
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise SettingTextError(f"settings text {text!r} is not a mapping like `{{topic: /x}}`")
    return value


def _load_yaml(text: str) -> object:
    """Load YAML. If it is JSON too, JSON's parser does so in a hundredth of the time."""
    try:
        # `NaN` and `Infinity`, which this parser accepts, are strings in YAML.
        return json.loads(text, parse_constant=str)
    except (ValueError, RecursionError):
        return load_yaml_core(text)


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


def format_component_setting(settings: Mapping[str, object]) -> str:
    """Format a component's settings, or callback groups, as the text of one ROS parameter.

    The result is flat text if every value is plain, because nodes of the first two generations of
    the API split it at `,` and `:`. Otherwise it is JSON. `parse_component_setting` reads both.
    """
    if settings and all(_FLAT_NAME.fullmatch(k) and _is_flat(v) for k, v in settings.items()):
        return ",".join(f"{key}:{_flat_scalar(value)}" for key, value in settings.items())
    return format_setting(settings)


def _is_flat(value: object) -> bool:
    if isinstance(value, str):
        return _FLAT_TEXT.fullmatch(value) is not None and core_scalar(value) == value
    return isinstance(value, bool | int) or (isinstance(value, float) and math.isfinite(value))


def _flat_scalar(value: object) -> str:
    return value if isinstance(value, str) else _format_scalar(value)


def format_setting(value: object) -> str:
    """Format a value as one line of JSON that `parse_mapping` parses to an equal value.

    Numbers that are not finite are written as in YAML, `.inf`.
    """
    if isinstance(value, Mapping):
        fields = (
            f"{quoted_scalar(str(key))}: {format_setting(item)}" for key, item in value.items()
        )
        return f"{{{', '.join(fields)}}}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(format_setting, value))}]"
    return quoted_scalar(value) if isinstance(value, str) else _format_scalar(value)


def _format_scalar(value: object) -> str:
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    return repr(value)
