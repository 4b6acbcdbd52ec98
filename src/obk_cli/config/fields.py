"""Read the keys of a mapping: each value has the right kind, or a finding is added and it is None.

Null counts as not set, except for required keys. Names that ROS would reject are findings, too.
"""

from collections.abc import Callable, Iterable, Mapping
from math import inf
from typing import Final, TypeVar

from obelisk_spec.names import (
    namespace_fault,
    node_name_fault,
    package_name_fault,
    topic_name_fault,
)
from obelisk_spec.suggestions import ask_for, list_names, near_names, sure_name
from obelisk_spec.values import LARGEST_COUNT, LONGEST_PERIOD_S, SHORTEST_PERIOD_S, is_none
from obelisk_spec.yaml_core import core_scalar
from obk_cli.config.fixes import remove_entry, respell
from obk_cli.config.model import Spanned
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap, TreeScalar, kind_of, shown
from obk_cli.diagnostics.diagnostic import Diagnostic, found
from obk_cli.diagnostics.edits import Edit
from obk_cli.diagnostics.source import Span

__all__ = [
    "COMPONENT_KEYS",
    "EXTERNAL_TOPIC_KEYS",
    "JOYSTICK_KEYS",
    "NODE_KEYS",
    "OBK_KEYS",
    "OLDER_KEYS",
    "QOS_KEYS",
    "RAY_CASTER_KEYS",
    "RESERVED_KEYS",
    "ROBOT_KEYS",
    "SECTION_KEYS",
    "SENSOR_GROUP_KEYS",
    "SIM_KEYS",
    "TIMER_KEYS",
    "VIZ_KEYS",
    "VIZ_NODE_KEYS",
    "Faults",
    "Fields",
    "check_namespace",
    "check_node_name",
    "check_package",
    "check_topic",
    "read_items",
    "read_text",
]

SECTION_KEYS: Final = ("control", "estimation", "robot", "sensing", "viz", "joystick")
RESERVED_KEYS: Final = (
    "config",
    "include",
    *SECTION_KEYS,
    "external_topics",
    "vars",
    "version",
    "obk",
)

NODE_KEYS: Final = (
    "pkg",
    "executable",
    "name",
    "namespace",
    "params_path",
    "params",
    "callback_groups",
    "publishers",
    "subscribers",
    "timers",
    "remappings",
    "log_level",
    "env",
    "respawn",
    "on_crash",
    "device",
    "impl",
)
ROBOT_KEYS: Final = (*NODE_KEYS, "is_simulated", "sim")
VIZ_NODE_KEYS: Final = (*NODE_KEYS, "robot_pkg", "urdf", "robot_topic", "tf_prefix")

COMPONENT_KEYS: Final = (
    "ros_parameter",
    "key",
    "topic",
    "msg_type",
    "history_depth",
    "qos",
    "callback_group",
    "max_age_sec",
    "stale_action",
    "callback_key",
    "non_obelisk",
)
TIMER_KEYS: Final = (
    "ros_parameter",
    "key",
    "timer_period_sec",
    "callback_group",
    "history_depth",
    "callback_key",
    "non_obelisk",
)
QOS_KEYS: Final = ("reliability", "durability", "history_depth")

SIM_KEYS: Final = (
    "ros_parameter",
    "model_xml_path",
    "robot_pkg",
    "num_steps_per_viz",
    "n_u",
    "time_step",
    "sensor_settings",
    "viz_geoms",
)
SENSOR_GROUP_KEYS: Final = (
    "topic",
    "dt",
    "msg_type",
    "history_depth",
    "sensor_names",
    "scan_config",
    "config_path",
    "noise",
    "dropout",
    "delay",
    "seed",
)
VIZ_KEYS: Final = ("on", "rviz_pkg", "rviz_config", "viz_nodes", "viz_tool")
JOYSTICK_KEYS: Final = (
    "on",
    "pub_topic",
    "sub_topic",
    "device_id",
    "device_name",
    "deadzone",
    "autorepeat_rate",
    "sticky_buttons",
    "coalesce_interval_ms",
)
OBK_KEYS: Final = ("ignore", "use_sim_time")
EXTERNAL_TOPIC_KEYS: Final = ("msg_type", "direction")
RAY_CASTER_KEYS: Final = ("site_name", "geom_groups", "pattern", "scan_config", "max_distance")

OLDER_KEYS: Final[Mapping[str, str]] = {"sensor_type": "msg_type"}
"""Older name of a sensor group's key -> the newer one."""
NO_EFFECT_KEYS: Final = ("non_obelisk", "callback_key", "impl", "viz_tool")
"""Keys of older configs that are accepted and ignored."""
_TIMER_NO_EFFECT_KEYS: Final = (*NO_EFFECT_KEYS, "history_depth")


T = TypeVar("T")

Faults = list[Diagnostic]

_MOST_COMPARED = 400
"""Maximum number of findings for which unknown keys are compared with known ones."""

_TOO_LARGE_FOR_FLOAT = 2**1023


class Fields:
    """The keys of one mapping; findings are added to the list passed to the constructor."""

    def __init__(self, tree: TreeMap, what: str, keys: tuple[str, ...], faults: Faults) -> None:
        self.tree = tree
        self._what = what
        self._faults = faults
        known = frozenset(keys)
        self._no_effect = _TIMER_NO_EFFECT_KEYS if keys is TIMER_KEYS else NO_EFFECT_KEYS
        self._entries = {entry.key: entry for entry in tree if entry.key in known}
        for entry in tree:
            if entry.key not in known:
                self._unknown(entry, keys)
            elif entry.key in self._no_effect:
                message = f"`{entry.key}` has no effect"
                edits = remove_entry(tree, entry)
                faults.append(found("OBK506", message, entry.key_span, fix=edits))

    def _unknown(self, entry: Entry, keys: tuple[str, ...]) -> None:
        useful = [key for key in keys if key not in self._no_effect]
        compared = useful if len(self._faults) < _MOST_COMPARED else []
        near = near_names(entry.key, compared)
        help = f"supported: {list_names(useful, most=20)}"
        key, colon, value = entry.key.partition(":")
        if colon and key in useful:
            help = f"put a space after the colon: `{key}: {value}`"
        elif near:
            help = ask_for(near) or help
        if near:
            # Read it as the key that was meant, so that nothing is reported missing.
            self._entries.setdefault(near[0], entry)
        message = f"`{entry.key}` is not a valid key of {self._what}"
        meant = sure_name(entry.key, compared)
        edits: tuple[Edit, ...] = ()
        if meant is not None and self.tree.get(meant) is None:
            edits = respell(entry.key_span, entry.key, meant)
        self._faults.append(found("OBK101", message, entry.key_span, help=help, fix=edits))

    def entry(self, key: str, *, required: bool = False) -> Entry | None:
        """The entry of a key whose value is not empty."""
        entry = self._entries.get(key)
        if entry is None:
            if required:
                message = f"{self._what} has no `{key}`"
                self._faults.append(found("OBK102", message, self.start))
            return None
        if isinstance(entry.value, TreeScalar) and entry.value.value is None:
            if required:
                self._faults.append(found("OBK103", f"`{key}` is empty", entry.key_span))
            return None
        return entry

    @property
    def start(self) -> Span:
        """The location of the mapping's first key, otherwise of the mapping."""
        first = next(iter(self.tree), None)
        return first.key_span if first else self.tree.span

    def text(self, key: str, *, required: bool = False) -> Spanned[str] | None:
        """A non-empty string."""
        return self._read(key, required, "text", _text)

    def any_text(self, key: str) -> Spanned[str] | None:
        """A string, which may be empty."""
        return self._read(key, False, "text", lambda value: value if type(value) is str else None)

    def no_or_text(self, key: str) -> Spanned[str] | None:
        """A string; the word `None`, in any case, counts as not set."""
        text = self.text(key)
        return None if text is None or is_none(text.value) else text

    def boolean(self, key: str) -> Spanned[bool] | None:
        """`true` or `false`."""
        return self._read(key, False, "`true` or `false`", _boolean)

    def count(self, key: str, *, least: int = 1) -> Spanned[int] | None:
        """A whole number of at least `least`."""
        expected = f"a whole number of at least {least}"
        number = self._read(key, False, expected, _integer)
        number = self._within(key, number, expected, lambda value: value >= least)
        expected = f"a whole number of at most {LARGEST_COUNT}, which fits into 32 bits"
        return self._within(key, number, expected, lambda value: value <= LARGEST_COUNT)

    def number(self, key: str, *, least: float, most: float) -> Spanned[float] | None:
        """A number within bounds, whole or not."""
        expected = f"a number from {least:g} to {most:g}"
        number = self._read(key, False, expected, _number)
        return self._within(key, number, expected, lambda value: least <= value <= most)

    def period_s(self, key: str, *, required: bool = False) -> Spanned[float] | None:
        """A number of seconds above 0 that fits in ROS's nanoseconds."""
        expected = "a number of seconds greater than 0"
        number = self._read(key, required, expected, _number)
        number = self._within(key, number, expected, lambda value: value > 0)
        expected = f"a number of seconds from {SHORTEST_PERIOD_S:g} to {LONGEST_PERIOD_S:g}"
        return self._within(
            key, number, expected, lambda value: SHORTEST_PERIOD_S <= value <= LONGEST_PERIOD_S
        )

    def one_of(self, key: str, allowed: Iterable[str]) -> Spanned[str] | None:
        """One of several words."""
        text = self.text(key)
        words = tuple(allowed)
        if text is None or text.value in words:
            return text
        message = f"`{key}` is `{text.value}`, expected one of {list_names(words)}"
        help = ask_for(near_names(text.value, words))
        meant = sure_name(text.value, words)
        edits = respell(text.span, text.value, meant) if meant else ()
        self._faults.append(found("OBK105", message, text.span, help=help, fix=edits))
        return None

    def mapping(self, key: str) -> TreeMap | None:
        """A mapping."""
        entry = self.entry(key)
        if entry is None:
            return None
        if isinstance(entry.value, TreeMap):
            return entry.value
        self._wrong(key, entry.value, "a mapping")
        return None

    def maps(self, key: str) -> tuple[TreeMap, ...]:
        """A list of mappings; a single mapping counts as a list of one."""
        entry = self.entry(key)
        return () if entry is None else read_items(key, entry.value, self._faults)

    def _read(
        self, key: str, required: bool, expected: str, convert: Callable[[object], T | None]
    ) -> Spanned[T] | None:
        entry = self.entry(key, required=required)
        if entry is None:
            return None
        value = convert(entry.value.value) if isinstance(entry.value, TreeScalar) else None
        if value is None:
            self._wrong(key, entry.value, expected)
            return None
        return Spanned(value, entry.value.span, entry.key_span)

    def _within(
        self, key: str, number: Spanned[T] | None, expected: str, is_within: Callable[[T], bool]
    ) -> Spanned[T] | None:
        if number is None or is_within(number.value):
            return number
        message = f"`{key}` is {shown(number.value)}, expected {expected}"
        self._faults.append(found("OBK104", message, number.span))
        return None

    def _wrong(self, key: str, value: Tree, expected: str) -> None:
        message = f"`{key}` is {kind_of(value)}, expected {expected}"
        self._faults.append(found("OBK103", message, value.span, help=_hint(value, expected)))


def read_items(key: str, tree: Tree, faults: Faults) -> tuple[TreeMap, ...]:
    """The mappings of a list; a single mapping counts as a list of one."""
    if isinstance(tree, TreeMap):
        return (tree,)
    if not isinstance(tree, TreeList):
        message = f"`{key}` is {kind_of(tree)}, expected a list of mappings"
        faults.append(found("OBK103", message, tree.span, help=_hint(tree, "a mapping")))
        return ()
    maps: list[TreeMap] = []
    for item in tree.items:
        if isinstance(item, TreeMap):
            maps.append(item)
        else:
            message = f"an item of `{key}` is {kind_of(item)}, expected a mapping"
            faults.append(found("OBK103", message, item.span, help=_hint(item, "a mapping")))
    return tuple(maps)


def read_text(what: str, tree: Tree, faults: Faults) -> Spanned[str] | None:
    """A value that must be text."""
    if isinstance(tree, TreeScalar) and isinstance(tree.value, str) and tree.value:
        return Spanned(tree.value, tree.span)
    message = f"{what} is {kind_of(tree)}, expected text"
    faults.append(found("OBK103", message, tree.span, help=_hint(tree, "text")))
    return None


def _hint(value: Tree, expected: str) -> str | None:
    if not isinstance(value, TreeScalar):
        return None
    if expected == "text" and value.value not in (None, ""):
        return f'write it in quotes: "{value.span.text}"'
    if isinstance(value.value, str):
        head, colon, tail = value.value.partition(":")
        if colon and head.isidentifier() and expected == "a mapping":
            return f"put a space after the colon: `{head}: {tail.strip()}`"
        if expected == "`true` or `false`" and value.value.lower() in ("yes", "no", "on", "off"):
            return f"in YAML 1.2 `{value.value}` is text; write `true` or `false`"
        is_quoted = value.value and value.span.text[:1] in ("'", '"')
        if is_quoted and not isinstance(core_scalar(value.value), str):
            bare = value.span.text[1:-1]
            where = ", which YAML allows outside of braces and brackets" if "${" in bare else ""
            return f"remove the quotes: `{bare}`{where}"
    return None


def _text(value: object) -> str | None:
    return value if isinstance(value, str) and value else None


def _boolean(value: object) -> bool | None:
    return value if isinstance(value, bool) else None


def _integer(value: object) -> int | None:
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if isinstance(value, int) and abs(value) >= _TOO_LARGE_FOR_FLOAT:
        return inf if value > 0 else -inf
    return float(value)


def check_topic(topic: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The topic; adds a finding if it is invalid."""
    return _checked(topic, topic_name_fault, "OBK109", "a topic name", faults)


def check_namespace(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The namespace; adds a finding if it is invalid."""
    return _checked(name, namespace_fault, "OBK110", "a namespace", faults)


def _name_part_fault(name: str) -> str | None:
    # A digit may come first, because the whole name starts with `obelisk_`.
    return node_name_fault(f"n{name}")


def check_node_name(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The node's part of a name; adds a finding if it is invalid."""
    return _checked(name, _name_part_fault, "OBK110", "part of a node name", faults)


def check_package(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The package's name; adds a finding if it is invalid."""
    return _checked(name, package_name_fault, "OBK111", "a package name", faults)


def _checked(
    name: Spanned[str] | None,
    fault_of: Callable[[str], str | None],
    code: str,
    what: str,
    faults: Faults,
) -> Spanned[str] | None:
    fault = fault_of(name.value) if name else None
    if name is not None and fault is not None:
        faults.append(found(code, f"`{name.value}` cannot be {what}: {fault}", name.span))
    # An invalid name is kept, so that what it names is not reported missing.
    return name
