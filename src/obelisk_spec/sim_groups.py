"""Checks of one sensor group of a `sim` block, against its rule and against the model.

Pure; the group must have the shape that `sim_shape` asks for.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from obelisk_spec.disturbances import check_disturbances
from obelisk_spec.messages import bare_name
from obelisk_spec.model import ModelFacts, SensorFact
from obelisk_spec.scans import check_scan
from obelisk_spec.sensors import SENSOR_GROUPS, GroupRule, sensor_group
from obelisk_spec.sim_faults import SimFault, SimPath
from obelisk_spec.suggestions import (
    ask_for,
    did_you_mean,
    list_names,
    near_names,
    sure_name,
    there_is,
)
from obelisk_spec.wording import with_article

__all__ = ["check_group_against_model", "check_group_rule"]

_CAMERA = "camera"
"""What stands for a sensor type where a camera of the model is named."""
_MOST_COMPARED = 100
"""Findings about a group's sensors with a near name; of further ones only the name is told."""
_ONE_PLACE = 2
"""From this many sensors on they can disagree about where they sit."""


def check_group_rule(
    group: Mapping[str, Any], path: SimPath, facts: ModelFacts | None
) -> Iterator[SimFault]:
    """Findings that need no model: the message, the sensor types, the ray pattern.

    The model only helps to say which type was meant.
    """
    written = str(group["msg_type"])
    rule = sensor_group(written)
    if rule is None:
        yield SimFault(
            code="OBK319",
            severity="error",
            path=(*path, "msg_type"),
            message=f"`{written}` is not a message that a sensor group can publish",
            help=did_you_mean(bare_name(written), SENSOR_GROUPS),
            meant=sure_name(written, SENSOR_GROUPS),
        )
        return
    refused: list[str] = []
    if rule.reads_sensors:
        names = group.get("sensor_names") or {}
        refused = [name for name, sensor_type in names.items() if sensor_type not in rule.takes]
        for name in refused:
            yield _not_carried(name, names[name], written, rule, path, facts)
        yield from _check_counts(names, written, rule, path, has_lost=bool(refused))
    yield from _check_scan_given(group, written, rule, path)
    yield from check_disturbances(group, path, has_lost=bool(refused))


def _not_carried(
    name: str,
    sensor_type: str,
    written: str,
    rule: GroupRule,
    path: SimPath,
    facts: ModelFacts | None,
) -> SimFault:
    sensor = facts.sensors.get(name) if facts is not None else None
    if _CAMERA in rule.takes and facts is not None and name in facts.cameras:
        help = f"write `{name}: {_CAMERA}`"
    elif sensor is not None and sensor.type in rule.takes:
        help = f"in the model it is {with_article(sensor.type)}: write `{name}: {sensor.type}`"
    else:
        near = ask_for(near_names(sensor_type, rule.takes))
        help = near or f"it takes {list_names(rule.takes)}"
    return SimFault(
        code="OBK305",
        severity="error",
        path=(*path, "sensor_names", name),
        message=f"`{written}` cannot carry the `{sensor_type}` sensor `{name}`",
        help=help,
        meant=sure_name(sensor_type, rule.takes),
    )


def _check_counts(
    names: Mapping[str, str], written: str, rule: GroupRule, path: SimPath, *, has_lost: bool
) -> Iterator[SimFault]:
    """How many there are of each type; `has_lost`: one that is missing may be written wrong."""
    counts = Counter(names.values())
    if not has_lost and not any(sensor_type in counts for sensor_type in rule.takes):
        yield SimFault(
            code="OBK306",
            severity="error",
            path=(*path, "sensor_names") if names else path,
            points_at="key" if names else "value",
            message=f"`{written}` has no sensor to publish",
            help=f"it takes {list_names(rule.takes)}",
        )
        return
    for sensor_type, use in rule.takes.items():
        if use.at_most is not None and counts[sensor_type] > use.at_most:
            last = [name for name, written_type in names.items() if written_type == sensor_type][-1]
            yield SimFault(
                code="OBK306",
                severity="error",
                path=(*path, "sensor_names", last),
                points_at="key",
                message=f"`{written}` takes {use.at_most} `{sensor_type}` sensor, "
                f"{counts[sensor_type]} are given",
                help="put the others into a sensor group of their own",
            )
        if counts[sensor_type] or has_lost or use.presence == "optional":
            continue
        yield SimFault(
            code="OBK306" if use.presence == "required" else "OBK307",
            severity="error" if use.presence == "required" else "info",
            path=(*path, "sensor_names"),
            points_at="key",
            message=f"`{written}` has no `{sensor_type}` sensor, "
            + ("which it needs" if use.presence == "required" else "so that part stays empty"),
        )


def _check_scan_given(
    group: Mapping[str, Any], written: str, rule: GroupRule, path: SimPath
) -> Iterator[SimFault]:
    scan = group.get("scan_config")
    if isinstance(scan, Mapping):
        yield from check_scan(scan, written, rule, (*path, "scan_config"))
    elif rule.patterns and group.get("config_path") is None:
        yield SimFault(
            code="OBK102",
            severity="error",
            path=path,
            message=f"a sensor group of `{written}` has neither `scan_config` nor `config_path`",
            help="it names the site that the rays start from, and their pattern",
        )


def check_group_against_model(
    group: Mapping[str, Any], path: SimPath, facts: ModelFacts
) -> Iterator[SimFault]:
    """Findings about names, types and places of the model's sensors and sites."""
    names: Mapping[str, str] = group.get("sensor_names") or {}
    rule = sensor_group(str(group["msg_type"]))
    told = 0
    for name, sensor_type in names.items():
        place = (*path, "sensor_names", name)
        is_compared = told < _MOST_COMPARED
        for fault in _check_sensor(name, sensor_type, place, facts, rule, is_compared=is_compared):
            told += 1
            yield fault
    if rule is not None:
        # Of a type that is given too often, which is reported, only the first counts.
        firsts = {kind: name for name, kind in reversed(list(names.items()))}
        found = [
            facts.sensors[name]
            for name, kind in names.items()
            if name in facts.sensors and (firsts[kind] == name or rule.objects == "scalar joint")
        ]
        yield from _check_one_place(found, rule, path, str(group["msg_type"]))
        if rule.patterns:
            scan, scan_path = group.get("scan_config") or {}, (*path, "scan_config")
            yield from _check_site(scan, scan_path, facts)
            yield from _check_frame(scan, scan_path, facts)


def _check_sensor(
    name: str,
    written: str,
    path: SimPath,
    facts: ModelFacts,
    rule: GroupRule | None,
    *,
    is_compared: bool,
) -> Iterator[SimFault]:
    if written == _CAMERA:
        yield from _check_camera(name, path, facts)
        return
    sensor = facts.sensors.get(name)
    if sensor is None:
        if rule is not None and _CAMERA in rule.takes and name in facts.cameras:
            return  # told as a type that the message does not carry
        sensors = facts.sensors.values() if is_compared else ()
        same_type = [sensor.name for sensor in sensors if sensor.type == written]
        yield SimFault(
            code="OBK303",
            severity="error",
            path=path,
            points_at="key",
            message=f"sensor `{name}` is not in the model",
            help=_near_sensors(name, same_type, facts) if is_compared else None,
            meant=sure_name(name, same_type),
        )
    elif sensor.type != written:
        if rule is not None and rule.reads_sensors and written not in rule.takes:
            return  # told as a type that the message does not carry
        yield SimFault(
            code="OBK304",
            severity="error",
            path=path,
            message=f"sensor `{name}` is written as `{written}`, in the model it is "
            f"{with_article(sensor.type)}",
            help=f"write `{name}: {sensor.type}`, or name {with_article(written)} sensor",
            element=("sensor", name),
        )
    elif rule and rule.objects == "scalar joint" and sensor.joint_type in ("ball", "free"):
        yield SimFault(
            code="OBK309",
            severity="error",
            path=path,
            points_at="key",
            message=f"sensor `{name}` is on the {sensor.joint_type} joint `{sensor.object_name}`, "
            "expected a hinge or slide joint",
            element=("joint", sensor.object_name),
        )


def _check_camera(name: str, path: SimPath, facts: ModelFacts) -> Iterator[SimFault]:
    if name not in facts.cameras:
        yield SimFault(
            code="OBK303",
            severity="error",
            path=path,
            points_at="key",
            message=f"camera `{name}` is not in the model",
            help=did_you_mean(name, facts.cameras),
            meant=sure_name(name, facts.cameras),
        )


def _near_sensors(name: str, same_type: Collection[str], facts: ModelFacts) -> str | None:
    """Near names among the sensors of the type that was written, else among all."""
    near = near_names(name, same_type) or near_names(name, facts.sensors)
    return ask_for(near) or there_is(same_type or facts.sensors)


def _check_one_place(
    found: list[SensorFact], rule: GroupRule, path: SimPath, written: str
) -> Iterator[SimFault]:
    placed = [sensor for sensor in found if sensor.type in rule.takes]
    if rule.objects not in ("one site", "one object") or len(placed) < _ONE_PLACE:
        return
    first, *others = placed
    for sensor in others:
        if (sensor.object_type, sensor.object_name) == (first.object_type, first.object_name):
            continue
        yield SimFault(
            code="OBK308",
            severity="error",
            path=(*path, "sensor_names", sensor.name),
            points_at="key",
            message=f"the sensors of `{written}` must sit at {rule.objects}: `{sensor.name}` is on "
            f"the {sensor.object_type} `{sensor.object_name}`, `{first.name}` on the "
            f"{first.object_type} `{first.object_name}`",
            element=("sensor", sensor.name),
        )


def _check_site(scan: Mapping[str, Any], path: SimPath, facts: ModelFacts) -> Iterator[SimFault]:
    site = scan.get("site_name")
    if isinstance(site, str) and site not in facts.sites:
        yield SimFault(
            code="OBK313",
            severity="error",
            path=(*path, "site_name"),
            message=f"site `{site}` is not in the model",
            help=did_you_mean(site, facts.sites),
            meant=sure_name(site, facts.sites),
        )


def _check_frame(scan: Mapping[str, Any], path: SimPath, facts: ModelFacts) -> Iterator[SimFault]:
    frame = scan.get("frame")
    frames = ("world", *facts.sites, *facts.bodies, *facts.geoms, *facts.cameras)
    if isinstance(frame, str) and frame not in frames:
        yield SimFault(
            code="OBK313",
            severity="error",
            path=(*path, "frame"),
            message=f"frame `{frame}` is neither `world` nor a site, body, geom or camera of the "
            "model",
            help=did_you_mean(frame, frames),
            meant=sure_name(frame, frames),
        )
