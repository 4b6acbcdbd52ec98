"""Check that a `sim` block has the right keys with values of the right types.

The tool shows a finding at its location in the config. A manually started simulator logs it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from obelisk_spec.values import (
    COUNT_RANGE,
    LARGEST_COUNT,
    LONGEST_PERIOD_S,
    PERIOD_RANGE,
    is_count,
    is_mapping,
    is_number,
    is_period,
    is_text,
    is_whole,
)

__all__ = [
    "CLOCK_RATE",
    "DEFAULT_STEPS_PER_VIZ",
    "REALTIME_FACTOR",
    "SimFault",
    "SimPath",
    "check_sim_shape",
    "parameter_fault",
]

DEFAULT_STEPS_PER_VIZ: Final = 8
"""Default of `num_steps_per_viz`."""
REALTIME_FACTOR: Final = "realtime_factor"
"""The parameter with the simulated time per wall time; 0 for as fast as possible."""
CLOCK_RATE: Final = "clock_rate"
"""The parameter with the maximum rate of `/clock` [Hz of simulated time]."""

SimPath = tuple[str | int, ...]
"""Keys and indexes into the sim block, or into the node's parameters if it starts with `params`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimFault:
    """A finding about a `sim` block; `str()` is its log line."""

    code: str
    severity: Literal["error", "warning", "info"]
    path: SimPath
    message: str
    help: str | None = None
    points_at: Literal["key", "value"] = "value"
    """Whether the finding is about the last key of `path` or about its value."""
    meant: str | None = None
    """The name to write instead; None if it is ambiguous."""
    element: tuple[str, str] | None = None
    """Kind (`sensor`, `geom`, `site`, `key`, `joint`) and name of the model element."""

    def __str__(self) -> str:
        place = "".join(
            f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.path
        ).lstrip(".")
        line = f"{self.severity}[{self.code}]: {place}: {self.message}"
        return f"{line} ({self.help})" if self.help else line


def _is_probability(value: object) -> bool:
    return is_number(value, 0, 1)


def _is_delay(value: object) -> bool:
    return is_number(value, 0, LONGEST_PERIOD_S)


def _is_seed(value: object) -> bool:
    return is_whole(value, 0, LARGEST_COUNT)


def _is_names(value: object) -> bool:
    return is_mapping(value) and all(map(is_text, value.values()))


def _is_geoms(value: object) -> bool:
    return is_mapping(value) and all(is_text(kind) for name, kind in value.items() if name != "dt")


def _is_list_of_mappings(value: object) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and all(isinstance(item, Mapping) for item in value)
    )


_DELAY: Final = f"a number of seconds from 0 to {LONGEST_PERIOD_S:g}"
_Rule = tuple[str, bool, Callable[[object], bool], str]

_BLOCK: tuple[_Rule, ...] = (
    ("model_xml_path", True, is_text, "a path"),
    ("num_steps_per_viz", False, is_count, COUNT_RANGE),
    ("time_step", False, is_period, PERIOD_RANGE),
    ("sensor_settings", False, _is_list_of_mappings, "a list of sensor groups"),
    ("viz_geoms", False, _is_geoms, "a mapping of geom names to geom types"),
)
_GROUP: tuple[_Rule, ...] = (
    ("topic", True, is_text, "a topic"),
    ("dt", True, is_period, PERIOD_RANGE),
    ("msg_type", True, is_text, "a message type"),
    ("history_depth", False, is_count, COUNT_RANGE),
    ("sensor_names", False, _is_names, "a mapping of sensor names to sensor types"),
    ("scan_config", False, is_mapping, "a mapping"),
    ("config_path", False, is_text, "a path"),
    ("noise", False, is_mapping, "a mapping of fields to their noise"),
    ("dropout", False, _is_probability, "a number from 0 to 1"),
    ("delay", False, _is_delay, _DELAY),
    ("seed", False, _is_seed, f"a whole number from 0 to {LARGEST_COUNT}"),
)


def parameter_fault(name: str, value: object) -> str | None:
    """Why the value of one of the simulator's ROS parameters is invalid; None if it may be valid.

    Only `REALTIME_FACTOR` and `CLOCK_RATE` are checked.
    """
    if name == REALTIME_FACTOR and not is_number(value, 0):
        return f"`{name}` is {value!r}, expected a number above 0, or 0 for as fast as possible"
    if name == CLOCK_RATE and not (is_number(value) and value > 0):
        return f"`{name}` is {value!r}, expected a number above 0 [Hz]"
    return None


def check_sim_shape(block: Mapping[str, Any]) -> tuple[SimFault, ...]:
    """Return findings about missing keys and values of the wrong type; empty for a valid block."""
    faults = list(_check(block, _BLOCK, ()))
    groups = block.get("sensor_settings")
    if _is_list_of_mappings(groups):
        for index, group in enumerate(groups or ()):
            faults += _check(group, _GROUP, ("sensor_settings", index))
    return tuple(faults)


def _check(
    mapping: Mapping[str, object], rules: tuple[_Rule, ...], path: SimPath
) -> Iterator[SimFault]:
    for key, required, is_valid, expected in rules:
        value = mapping.get(key)
        if value is None and required:
            yield SimFault(
                code="OBK102", severity="error", path=path, message=f"key `{key}` is missing"
            )
        elif value is not None and not is_valid(value):
            yield SimFault(
                code="OBK103",
                severity="error",
                path=(*path, key),
                message=f"`{key}` is {value!r}, expected {expected}",
            )
