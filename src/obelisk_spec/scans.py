"""Check the settings of a ray caster, and count the rays of its pattern.

The input is the mapping in `scan_config`, or in the file that `config_path` names, as plain values.
The paths of findings are relative to the sim block. Counts and defaults are those of the original
Obelisk, whose patterns are those of Isaac Lab; any behavior that differs from theirs needs a key.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from obelisk_spec.names import bare_name
from obelisk_spec.sensors import RAY_PATTERNS, GroupRule
from obelisk_spec.sim_block import SimFault, SimPath
from obelisk_spec.suggestions import did_you_mean, list_names, with_article
from obelisk_spec.values import COUNT_RANGE, is_count, is_mapping, is_number, is_text

__all__ = [
    "DEFAULT_FRAME",
    "DEFAULT_GROUPS",
    "MOST_RAYS",
    "OFFSET_KEYS",
    "PATTERN_KEYS",
    "SCAN_KEYS",
    "check_scan",
    "grid_count",
    "lidar_columns",
    "points_are_in_frame",
]

DEFAULT_FRAME: Final = "world"
DEFAULT_GROUPS: Final = (0,)

MOST_RAYS: Final = 1_000_000
"""Maximum for one pattern; casting more rays takes seconds."""

_GEOM_GROUPS = range(6)
_TURN_DEG = 360.0
_ROUNDING = 1e-6
"""Relative rounding error of a quotient: 1.6 / 0.1 may be slightly below 16."""


@dataclass(frozen=True, slots=True)
class ScanKey:
    """The values that a key accepts."""

    expected: str
    is_valid: Callable[[Any], bool]
    required: bool = False


def _is_positive(value: object) -> bool:
    return is_number(value) and value > 0


def _is_distance(value: object) -> bool:
    return is_number(value) and value >= 0


def _one_of(*words: str) -> ScanKey:
    expected = ", ".join(f"`{word}`" for word in words[:-1]) + f" or `{words[-1]}`"
    return ScanKey(expected, lambda value: value in words)


def _numbers(count: int) -> Callable[[Any], bool]:
    def is_valid(value: Any) -> bool:
        return (
            isinstance(value, list | tuple) and len(value) == count and all(map(is_number, value))
        )

    return is_valid


def _is_grid(value: Any) -> bool:
    return _numbers(2)(value) and min(value) >= 0


def _is_direction(value: Any) -> bool:
    return _numbers(3)(value) and any(value)


def _is_quaternion(value: Any) -> bool:
    return _numbers(4)(value) and any(value)


def _is_pinhole(value: Any) -> bool:
    return (
        _numbers(9)(value)
        and value[0] > 0
        and value[4] > 0
        and value[3] == 0
        and list(value[6:]) == [0, 0, 1]
    )


_CLOUD: Final = "PointCloud2"
_SCAN: Final = "ObkScan"
_CLOUD_KEYS: Final = ("points_in", "keep_misses")
"""Keys that only affect the points of a cloud."""
_LENGTH: Final = "a length in meters greater than 0"
_DIRECTION: Final = ScanKey("three numbers, not all 0", _is_direction)
_OFFSET: Final = ScanKey("a mapping with string keys", is_mapping)
SCAN_KEYS: Final[Mapping[str, ScanKey]] = {
    "site_name": ScanKey("the name of a site", is_text, required=True),
    "pattern": ScanKey("a mapping with string keys", is_mapping, required=True),
    "geom_groups": ScanKey("a list of geom groups", lambda value: isinstance(value, list | tuple)),
    "frame": ScanKey("the name of a frame", is_text),
    "points_in": _one_of("site", "frame"),
    "keep_misses": ScanKey("`true` or `false`", lambda value: isinstance(value, bool)),
    "max_distance": ScanKey("a length in meters, 0 for no limit", _is_distance),
    "viz_decimation": ScanKey(COUNT_RANGE, is_count),
}
PATTERN_KEYS: Final[Mapping[str, Mapping[str, ScanKey]]] = {
    "height_scan": {
        "resolution": ScanKey(_LENGTH, _is_positive, required=True),
        "size": ScanKey("two lengths in meters", _is_grid, required=True),
        "ordering": _one_of("xy", "yx"),
        "direction": _DIRECTION,
        "values": _one_of("height", "distance"),
    },
    "lidar_scan": {
        "channels": ScanKey(COUNT_RANGE, is_count, required=True),
        "vertical_fov_range": ScanKey("two angles in degrees", _numbers(2), required=True),
        "horizontal_fov_range": ScanKey("two angles in degrees", _numbers(2), required=True),
        "horizontal_res": ScanKey(
            "an angle in degrees greater than 0", _is_positive, required=True
        ),
        "spacing": _one_of("even", "exact"),
        "direction": _DIRECTION,
    },
    "depth_camera": {
        "width": ScanKey(COUNT_RANGE, is_count, required=True),
        "height": ScanKey(COUNT_RANGE, is_count, required=True),
        "intrinsic_matrix": ScanKey(
            "nine numbers, row by row: fx, skew, cx, 0, fy, cy, 0, 0, 1 with fx and fy above 0",
            _is_pinhole,
            required=True,
        ),
        "rays_through": _one_of("corners", "centres"),
        "direction": _DIRECTION,
    },
}
OFFSET_KEYS: Final[Mapping[str, ScanKey]] = {
    "pos": ScanKey("three lengths in meters", _numbers(3)),
    "rot": ScanKey("a quaternion of four numbers, w first, not all 0", _is_quaternion),
}


def check_scan(
    scan: Mapping[str, Any], written: str, rule: GroupRule, path: SimPath
) -> Iterator[SimFault]:
    """Yield findings about the ray caster at `path` in a sensor group of type `written`."""
    yield from _check_keys(scan, "a ray caster", SCAN_KEYS, path)
    if is_count(scan.get("viz_decimation")):
        yield _no_effect("viz_decimation", path)
    if rule.patterns and bare_name(written) != _CLOUD:
        for name in _CLOUD_KEYS:
            if scan.get(name) is not None:
                yield _no_effect(name, path, f": {with_article(written)} has no points")
    yield from _check_groups(scan.get("geom_groups"), (*path, "geom_groups"))
    pattern = scan.get("pattern")
    if is_mapping(pattern):
        yield from _check_pattern(pattern, written, rule, (*path, "pattern"))


def points_are_in_frame(scan: Mapping[str, Any], written: str) -> bool:
    """Whether a group of type `written` gives points in `frame`, which must be in the model."""
    return bare_name(written) == _CLOUD and scan.get("points_in") == "frame"


def _no_effect(name: str, path: SimPath, reason: str = "") -> SimFault:
    return SimFault(
        code="OBK506",
        severity="info",
        path=(*path, name),
        points_at="key",
        message=f"`{name}` has no effect{reason}",
    )


def _check_groups(groups: object, path: SimPath) -> Iterator[SimFault]:
    for index, group in enumerate(groups if isinstance(groups, list | tuple) else ()):
        if not (isinstance(group, int) and group in _GEOM_GROUPS):
            yield SimFault(
                code="OBK314",
                severity="error",
                path=(*path, index),
                message=f"geom group {group!r} does not exist",
                help="MuJoCo has geom groups 0 to 5",
            )


def _check_pattern(
    pattern: Mapping[str, Any], written: str, rule: GroupRule, path: SimPath
) -> Iterator[SimFault]:
    kind = pattern.get("type")
    if kind not in RAY_PATTERNS:
        yield _no_pattern(kind, path)
        return
    if rule.patterns and kind not in rule.patterns:
        yield SimFault(
            code="OBK305",
            severity="error",
            path=(*path, "type"),
            message=f"`{written}` cannot carry the ray pattern `{kind}`",
            help=f"it takes {list_names(rule.patterns)}",
        )
    keys = {"type": ScanKey("text", is_text), "offset": _OFFSET, **PATTERN_KEYS[kind]}
    faults = list(_check_keys(pattern, with_article(kind), keys, path))
    yield from faults
    if not faults:
        yield from _check_ray_count(pattern, path)
        if pattern.get("values") is not None and bare_name(written) != _SCAN:
            yield _no_effect("values", path, f": only an `{_SCAN}` has one value per ray")
        if pattern.get("direction") is not None and kind != "height_scan":
            yield _no_effect("direction", path, f": each ray of a `{kind}` has its own")
    offset = pattern.get("offset")
    if is_mapping(offset):
        yield from _check_keys(offset, "an `offset`", OFFSET_KEYS, (*path, "offset"))


def grid_count(length_m: float, resolution_m: float) -> int:
    """Number of rays along a side of a height scan, with both endpoints if they are on the grid."""
    return math.floor(length_m / resolution_m + _ROUNDING) + 1


def lidar_columns(span_deg: float, step_deg: float, *, is_exact: bool) -> tuple[int, float]:
    """Compute the number of rays per channel, and the angle between adjacent ones [deg].

    The original Obelisk uses `ceil(span / step)` rays, spreads them from the first to the last
    angle, and omits the last one of a full turn: 360 in steps of 2 gives 179 rays, 360 / 179
    degrees apart. With `is_exact`, rays are `step_deg` apart, with both endpoints; a full turn has
    only one.
    """
    span_deg = abs(span_deg)
    is_turn = abs(span_deg - _TURN_DEG) < _ROUNDING
    if is_exact:
        steps = math.floor(span_deg / step_deg + _ROUNDING)
        closes = is_turn and abs(steps * step_deg - _TURN_DEG) < _ROUNDING
        return (steps if closes else steps + 1), step_deg
    count = max(1, math.ceil(span_deg / step_deg - _ROUNDING))
    if count == 1:
        return 1, step_deg
    return (count - 1 if is_turn else count), span_deg / (count - 1)


def _check_ray_count(pattern: Mapping[str, Any], path: SimPath) -> Iterator[SimFault]:
    match pattern["type"]:
        case "height_scan":
            sides = [length / pattern["resolution"] + 1 for length in pattern["size"]]
        case "lidar_scan":
            first, last = pattern["horizontal_fov_range"]
            sides = [pattern["channels"], abs(last - first) / pattern["horizontal_res"] + 1]
        case _:
            sides = [pattern["width"], pattern["height"]]
    count = float(sides[0]) * float(sides[1])
    if count > MOST_RAYS:
        yield SimFault(
            code="OBK103",
            severity="error",
            path=path,
            message=f"`pattern` has {count:.3g} rays, expected at most {MOST_RAYS}",
        )


def _no_pattern(kind: object, path: SimPath) -> SimFault:
    if kind is None:
        return SimFault(
            code="OBK102",
            severity="error",
            path=path,
            message="a ray pattern has no `type`",
            help=f"it is one of {list_names(RAY_PATTERNS)}",
        )
    return SimFault(
        code="OBK105",
        severity="error",
        path=(*path, "type"),
        message=f"`type` is `{kind}`, expected one of {list_names(RAY_PATTERNS)}",
        help=did_you_mean(str(kind), RAY_PATTERNS),
    )


def _check_keys(
    mapping: Mapping[str, Any], what: str, keys: Mapping[str, ScanKey], path: SimPath
) -> Iterator[SimFault]:
    for name in mapping:
        if name not in keys:
            yield SimFault(
                code="OBK101",
                severity="error",
                path=(*path, name),
                points_at="key",
                message=f"`{name}` is not a valid key of {what}",
                help=did_you_mean(name, keys),
            )
    for name, key in keys.items():
        value = mapping.get(name)
        if value is None and key.required:
            yield SimFault(
                code="OBK102", severity="error", path=path, message=f"{what} has no `{name}`"
            )
        elif value is not None and not key.is_valid(value):
            yield SimFault(
                code="OBK103",
                severity="error",
                path=(*path, name),
                message=f"`{name}` is {_shown(value)}, expected {key.expected}",
            )


def _shown(value: object) -> str:
    match value:
        case Mapping():
            return "a mapping"
        case list() | tuple():
            return f"a list of {len(value)}"
        case str():
            return f"the string `{value}`"
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
