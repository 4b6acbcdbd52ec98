"""Parse component settings from ROS parameters into typed values.

The settings come from the component's own parameter, an entry in `obelisk_settings`, or a default.
The results are frozen values that include a QoS profile. `ObeliskConfigError` names the component
and the expected value.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from obelisk_py.core.command_watchdog import StalePolicy
from obelisk_py.core.components import ComponentKind, RegisteredComponent, spellings
from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskMsgError
from obelisk_py.core.messages import message_class, message_name, require_message
from obelisk_spec.components import (
    CALLBACK_GROUP_TYPES,
    CALLBACK_GROUPS_PARAMETER,
    CONTROL_SUBSCRIPTION,
    DEFAULT_HISTORY_DEPTH,
    DEFAULT_STALE_ACTION,
    STALE_ACTIONS,
    parse_component_setting,
    parse_mapping,
)
from obelisk_spec.names import topic_name_fault
from obelisk_spec.suggestions import with_article
from obelisk_spec.values import (
    COUNT_RANGE,
    LONGEST_PERIOD_S,
    SHORTEST_PERIOD_S,
    is_count,
    is_none,
    is_number,
)

__all__ = [
    "NodeSettings",
    "TimerSettings",
    "TopicSettings",
    "check_component",
    "entry_names",
    "find_settings",
    "message_class_of",
    "parse_node_settings",
    "stale_policy",
    "timer_settings",
    "topic_settings",
]

P = TypeVar("P")

_SUBSTITUTION: Final = re.compile(r"\{(node|ns|namespace)\}")
"""Placeholder in a topic that ROS replaces with a name."""
RELIABILITY = {
    "reliable": QoSReliabilityPolicy.RELIABLE,
    "best_effort": QoSReliabilityPolicy.BEST_EFFORT,
}
DURABILITY = {
    "volatile": QoSDurabilityPolicy.VOLATILE,
    "transient_local": QoSDurabilityPolicy.TRANSIENT_LOCAL,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSettings:
    """Settings of a publisher or subscription."""

    topic: str
    msg_type: str | None
    qos: QoSProfile
    callback_group: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimerSettings:
    """Settings of a timer."""

    period_s: float
    callback_group: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSettings:
    """The contents of the ROS parameter `obelisk_settings`."""

    components: Mapping[ComponentKind, tuple[Mapping[str, Any], ...]]
    callback_groups: Mapping[str, str]


def parse_node_settings(text: str, groups_text: str = "") -> NodeSettings:
    """Parse the `obelisk_settings` ROS parameter; an empty string has no settings.

    Args:
        text: the parameter's value.
        groups_text: the `callback_group_settings` parameter of older launchers.

    Raises:
        ObeliskConfigError: it is not a mapping of lists of mappings, or has an unknown group type.
    """
    block = _parsed(parse_mapping, text, "the parameter `obelisk_settings`")
    groups = block.get("callback_groups") or {}
    if not isinstance(groups, Mapping):
        raise ObeliskConfigError("obelisk_settings: `callback_groups` is not a mapping")
    where = f"the parameter `{CALLBACK_GROUPS_PARAMETER}`"
    groups = {**_parsed(parse_component_setting, groups_text, where), **groups}
    for name, kind in groups.items():
        if kind not in CALLBACK_GROUP_TYPES:
            raise ObeliskConfigError(
                f"callback group `{name}` has the type `{kind}`; expected one of: "
                f"{', '.join(CALLBACK_GROUP_TYPES)}"
            )
    return NodeSettings(
        components={kind: _entries(block.get(kind.value), kind) for kind in ComponentKind},
        callback_groups=dict(groups),
    )


def find_settings(
    component: RegisteredComponent, parameter_text: str, node: NodeSettings
) -> Mapping[str, Any] | None:
    """Return a component's settings from the first source that has them, or None.

    The order is: its own ROS parameter, its entry in `obelisk_settings`, the default in the code.
    Settings from the ROS parameter that have no `key` get the one of the entry.

    Raises:
        ObeliskConfigError: a source cannot be parsed, or a name in it is not a string.
    """
    entry = next(
        (e for e in node.components[component.kind] if component.names & entry_names(e)), None
    )
    if parameter_text.strip():
        where = f"the parameter `{component.ros_parameter}`"
        own = _parsed(parse_component_setting, parameter_text, where)
        entry_names(own)  # raises an exception if a name is not a string
        return {"key": entry["key"], **own} if entry and "key" in entry else own
    if entry is not None:
        return entry
    if isinstance(component.default, str):
        return _parsed(
            parse_component_setting, component.default, f"the default of the {component}"
        )
    return component.default


def check_component(component: RegisteredComponent, parameter_text: str, node_text: str) -> None:
    """Check a component's settings as `configure` does, without creating anything.

    Args:
        component: the component.
        parameter_text: value of its own ROS parameter.
        node_text: value of the ROS parameter `obelisk_settings`.

    Raises:
        ObeliskError: the settings cannot be parsed, or a value is out of range.
    """
    raw = find_settings(component, parameter_text, parse_node_settings(node_text))
    if raw is None:
        return
    if component.kind is ComponentKind.TIMER:
        timer_settings(component, raw)
        return
    message_class_of(component, topic_settings(component, raw).msg_type)
    if component.key == CONTROL_SUBSCRIPTION:
        stale_policy(component, raw)


def message_class_of(component: RegisteredComponent, configured: str | None) -> type[Any]:
    """Return the message class of a publisher or subscription.

    Raises:
        ObeliskMsgError: neither code nor config names one, they differ, or it does not exist.
    """
    if component.msg_type is None and configured is None:
        raise ObeliskMsgError(
            f"the {component} has no message type: set `msg_type` in the config or in the code"
        )
    if component.msg_type is None:
        assert configured is not None
        return message_class(configured)
    if configured is None:
        return require_message(component.msg_type)
    # A bare name may belong to one of the user's own message packages.
    is_bare = configured == component.msg_type.__name__
    if not is_bare and message_class(configured) is not component.msg_type:
        raise ObeliskMsgError(
            f"the {component} is {with_article(message_name(component.msg_type))} in the code "
            f"and {with_article(configured)} in the config"
        )
    return require_message(component.msg_type)


def entry_names(entry: Mapping[str, Any]) -> frozenset[str]:
    """Return every name of a settings entry, in all spellings.

    Raises:
        ObeliskConfigError: a name is not a string.
    """
    for key in ("ros_parameter", "key"):
        if not isinstance(entry.get(key, ""), str | None):
            raise ObeliskConfigError(
                f"the settings {dict(entry)}: `{key}` is {entry[key]!r}, expected a string"
            )
    return spellings(entry.get("ros_parameter"), entry.get("key"))


def topic_settings(component: RegisteredComponent, raw: Mapping[str, Any]) -> TopicSettings:
    """Parse the settings of a publisher or subscription.

    Raises:
        ObeliskConfigError: the topic is missing or invalid, or a value is out of range.
    """
    topic = raw.get("topic")
    if not isinstance(topic, str) or not topic:
        raise ObeliskConfigError(f"the {component} has no `topic` in its settings {dict(raw)}")
    fault = topic_name_fault(_SUBSTITUTION.sub("name", topic))
    if fault is not None:
        raise ObeliskConfigError(f"the {component}: invalid topic name `{topic}`: {fault}")
    qos = raw.get("qos") or {}
    if not isinstance(qos, Mapping):
        raise ObeliskConfigError(f"the {component}: `qos` is {qos!r}, expected a mapping")
    depth = qos.get("history_depth", raw.get("history_depth", DEFAULT_HISTORY_DEPTH))
    if isinstance(depth, float) and depth.is_integer():
        depth = int(depth)
    if not is_count(depth):
        raise ObeliskConfigError(
            f"the {component}: `history_depth` is {depth!r}, expected {COUNT_RANGE}"
        )
    return TopicSettings(
        topic=topic,
        msg_type=_named(raw.get("msg_type")),
        qos=QoSProfile(
            depth=depth,
            reliability=_policy(component, qos, "reliability", "reliable", RELIABILITY),
            durability=_policy(component, qos, "durability", "volatile", DURABILITY),
        ),
        callback_group=_named(raw.get("callback_group")),
    )


def timer_settings(component: RegisteredComponent, raw: Mapping[str, Any]) -> TimerSettings:
    """Parse the settings of a timer.

    Raises:
        ObeliskConfigError: the period is missing or out of the range of ROS timers.
    """
    period_s = _seconds(component, "timer_period_sec", raw.get("timer_period_sec"))
    return TimerSettings(period_s=period_s, callback_group=_named(raw.get("callback_group")))


def stale_policy(component: RegisteredComponent, raw: Mapping[str, Any]) -> StalePolicy | None:
    """Parse the policy for stale commands; None if the settings have none.

    Raises:
        ObeliskConfigError: the age is missing or out of range, or the action is unknown.
    """
    age, action = raw.get("max_age_sec"), raw.get("stale_action")
    if age is None and action is None:
        return None
    if action not in (None, *STALE_ACTIONS):
        raise ObeliskConfigError(
            f"the {component}: `stale_action` is `{action}`; expected one of: "
            f"{', '.join(STALE_ACTIONS)}"
        )
    return StalePolicy(
        max_age_s=_seconds(component, "max_age_sec", age), action=action or DEFAULT_STALE_ACTION
    )


def _seconds(component: RegisteredComponent, key: str, value: Any) -> float:
    if not is_number(value, SHORTEST_PERIOD_S, LONGEST_PERIOD_S):
        raise ObeliskConfigError(
            f"the {component}: `{key}` is {value!r}, expected a number of seconds above 0, "
            f"from {SHORTEST_PERIOD_S:g} to {LONGEST_PERIOD_S:g}"
        )
    return float(value)


def _policy(
    component: RegisteredComponent,
    qos: Mapping[str, Any],
    key: str,
    default: str,
    table: Mapping[str, P],
) -> P:
    value = str(qos.get(key, default)).lower()
    if value not in table:
        raise ObeliskConfigError(
            f"the {component}: qos `{key}` is `{value}`; expected one of: {', '.join(table)}"
        )
    return table[value]


def _named(value: Any) -> str | None:
    # The config language writes the string `None` for "not set".
    return None if value in (None, "") or is_none(value) else str(value)


def _entries(value: Any, kind: ComponentKind) -> tuple[Mapping[str, Any], ...]:
    if value is None:
        return ()
    if not isinstance(value, Iterable) or not all(isinstance(e, Mapping) for e in value):
        raise ObeliskConfigError(f"obelisk_settings: `{kind.value}` is not a list of mappings")
    return tuple(value)


def _parsed(parse: Any, text: str, where: str) -> dict[str, Any]:
    try:
        return parse(text)  # type: ignore[no-any-return]
    except ValueError as error:
        raise ObeliskConfigError(f"{where} cannot be read: {error}") from error
