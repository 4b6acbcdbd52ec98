"""Checks of a ray caster, inline as `scan_config` or from the file of `config_path`.

Pure; takes the mapping as plain values, gives findings with the path into the sim block.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

from obelisk_spec.near import did_you_mean, list_names
from obelisk_spec.sensors import RAY_PATTERNS, GroupRule
from obelisk_spec.sim_faults import SimFault, SimPath

__all__ = ["OFFSET_KEYS", "PATTERN_KEYS", "SCAN_KEYS", "ScanKey", "check_scan"]

_GEOM_GROUPS = range(6)


@dataclass(frozen=True, slots=True)
class ScanKey:
    """What a key takes."""

    wanted: str
    is_right: Callable[[Any], bool]
    required: bool = False


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _is_positive(value: Any) -> bool:
    return _is_number(value) and value > 0


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def _is_mapping(value: object) -> bool:
    return isinstance(value, Mapping)


def _numbers(count: int) -> Callable[[Any], bool]:
    def is_right(value: Any) -> bool:
        return (
            isinstance(value, list | tuple) and len(value) == count and all(map(_is_number, value))
        )

    return is_right


_LENGTH: Final = "a length in metres greater than 0"
_OFFSET: Final = ScanKey("a mapping", _is_mapping)
SCAN_KEYS: Final[Mapping[str, ScanKey]] = {
    "site_name": ScanKey("the name of a site", _is_text, required=True),
    "pattern": ScanKey("a mapping", _is_mapping, required=True),
    "geom_groups": ScanKey("a list of geom groups", lambda value: isinstance(value, list | tuple)),
    "frame": ScanKey("the name of a frame", _is_text),
    "max_distance": ScanKey(_LENGTH, _is_positive),
    "viz_decimation": ScanKey("a whole number of at least 1", _is_count),
}
PATTERN_KEYS: Final[Mapping[str, Mapping[str, ScanKey]]] = {
    "height_scan": {
        "resolution": ScanKey(_LENGTH, _is_positive, required=True),
        "size": ScanKey("two lengths in metres", _numbers(2), required=True),
        "ordering": ScanKey("`xy` or `yx`", lambda value: value in ("xy", "yx")),
    },
    "lidar_scan": {
        "channels": ScanKey("a whole number of at least 1", _is_count, required=True),
        "vertical_fov_range": ScanKey("two angles in degrees", _numbers(2), required=True),
        "horizontal_fov_range": ScanKey("two angles in degrees", _numbers(2), required=True),
        "horizontal_res": ScanKey(
            "an angle in degrees greater than 0", _is_positive, required=True
        ),
    },
    "depth_camera": {
        "width": ScanKey("a whole number of at least 1", _is_count, required=True),
        "height": ScanKey("a whole number of at least 1", _is_count, required=True),
        "intrinsic_matrix": ScanKey("nine numbers, row by row", _numbers(9), required=True),
    },
}
OFFSET_KEYS: Final[Mapping[str, ScanKey]] = {
    "pos": ScanKey("three lengths in metres", _numbers(3)),
    "rot": ScanKey("a quaternion of four numbers, w first", _numbers(4)),
}


def check_scan(
    scan: Mapping[str, Any], written: str, rule: GroupRule, path: SimPath
) -> Iterator[SimFault]:
    """Findings about a ray caster of the group `written`; `path` leads to the ray caster."""
    yield from _check_keys(scan, "a ray caster", SCAN_KEYS, path)
    yield from _check_groups(scan.get("geom_groups"), (*path, "geom_groups"))
    pattern = scan.get("pattern")
    if isinstance(pattern, Mapping):
        yield from _check_pattern(pattern, written, rule, (*path, "pattern"))


def _check_groups(groups: object, path: SimPath) -> Iterator[SimFault]:
    for index, group in enumerate(groups if isinstance(groups, list | tuple) else ()):
        if not (isinstance(group, int) and group in _GEOM_GROUPS):
            yield SimFault(
                code="OBK314",
                severity="error",
                path=(*path, index),
                message=f"geom group {group!r} does not exist",
                help="MuJoCo has the groups 0 to 5",
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
    keys = {"type": ScanKey("text", _is_text), "offset": _OFFSET, **PATTERN_KEYS[kind]}
    yield from _check_keys(pattern, f"a `{kind}`", keys, path)
    offset = pattern.get("offset")
    if isinstance(offset, Mapping):
        yield from _check_keys(offset, "an `offset`", OFFSET_KEYS, (*path, "offset"))


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
                message=f"{what} has no key `{name}`",
                help=did_you_mean(name, keys),
            )
    for name, key in keys.items():
        value = mapping.get(name)
        if value is None and key.required:
            yield SimFault(
                code="OBK102", severity="error", path=path, message=f"{what} has no `{name}`"
            )
        elif value is not None and not key.is_right(value):
            yield SimFault(
                code="OBK103",
                severity="error",
                path=(*path, name),
                message=f"`{name}` is {_shown(value)}, expected {key.wanted}",
            )


def _shown(value: object) -> str:
    match value:
        case Mapping():
            return "a mapping"
        case list() | tuple():
            return f"a list of {len(value)}"
        case str():
            return f"the text `{value}`"
    return str(value)
