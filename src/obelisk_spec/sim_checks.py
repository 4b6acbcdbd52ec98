"""Check a `sim` block; used by the tool before a launch and by the simulator in `configure`.

The inputs are the block, the node's parameters and the facts about a model; the outputs are
findings.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from obelisk_spec.model import ModelFacts, SensorFact
from obelisk_spec.names import bare_name
from obelisk_spec.scans import DEFAULT_FRAME, check_scan, points_are_in_frame
from obelisk_spec.sensors import SENSOR_GROUPS, GroupRule, check_noise, sensor_group
from obelisk_spec.sim_block import SimFault, SimPath, check_sim_shape
from obelisk_spec.suggestions import (
    ask_for,
    did_you_mean,
    list_names,
    near_names,
    sure_name,
    there_is,
    with_article,
    with_number,
)
from obelisk_spec.values import LONGEST_PERIOD_S, SHORTEST_PERIOD_S, is_number

__all__ = ["SimFault", "SimPath", "check_sim", "is_time_step"]

_CAMERA = "camera"
"""The sensor type of an entry that names a camera of the model."""
_MOST_COMPARED = 100
"""Maximum number of findings per group that suggest a similar name."""
_ONE_PLACE = 2
"""Minimum number of sensors that can be in different places."""


def check_group_rule(
    group: Mapping[str, Any], path: SimPath, facts: ModelFacts | None
) -> Iterator[SimFault]:
    """Yield findings that need no model: the message, the sensor types, the ray pattern.

    A model only improves the suggestion of a type.
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
    rejected: list[str] = []
    if rule.reads_sensors:
        names = group.get("sensor_names") or {}
        rejected = [name for name, sensor_type in names.items() if sensor_type not in rule.takes]
        for name in rejected:
            yield _not_carried(name, names[name], written, rule, path, facts)
        yield from _check_counts(names, written, rule, path, is_incomplete=bool(rejected))
    yield from _check_scan_given(group, written, rule, path)
    yield from check_noise(group, path, is_incomplete=bool(rejected))


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
    names: Mapping[str, str], written: str, rule: GroupRule, path: SimPath, *, is_incomplete: bool
) -> Iterator[SimFault]:
    """Check the number of sensors per type; `is_incomplete`: one may have a wrong type."""
    counts = Counter(names.values())
    if not is_incomplete and not any(sensor_type in counts for sensor_type in rule.takes):
        yield SimFault(
            code="OBK306",
            severity="error",
            path=(*path, "sensor_names") if names else path,
            points_at="key" if names else "value",
            message=f"this `{written}` group lists no sensors",
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
                message=f"`{written}` takes {use.at_most} `{sensor_type}` sensor, but has "
                f"{counts[sensor_type]}",
                help="move the others to a separate sensor group",
            )
        if counts[sensor_type] or is_incomplete or use.presence == "optional":
            continue
        yield SimFault(
            code="OBK306" if use.presence == "required" else "OBK307",
            severity="error" if use.presence == "required" else "info",
            path=(*path, "sensor_names"),
            points_at="key",
            message=f"`{written}` has no `{sensor_type}` sensor, "
            + (
                "which it needs"
                if use.presence == "required"
                else "so the fields for it are not filled in"
            ),
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
            help="it sets the site where the rays start, and their pattern",
        )


def check_group_against_model(
    group: Mapping[str, Any], path: SimPath, facts: ModelFacts
) -> Iterator[SimFault]:
    """Yield findings about names, types and locations of the model's sensors and sites."""
    names: Mapping[str, str] = group.get("sensor_names") or {}
    rule = sensor_group(str(group["msg_type"]))
    reported = 0
    for name, sensor_type in names.items():
        place = (*path, "sensor_names", name)
        is_compared = reported < _MOST_COMPARED
        for fault in _check_sensor(name, sensor_type, place, facts, rule, is_compared=is_compared):
            reported += 1
            yield fault
    if rule is not None:
        # If a type has too many sensors, which is reported elsewhere, only the first one counts.
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
            if points_are_in_frame(scan, str(group["msg_type"])):
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
            return  # reported as a type that the message cannot carry
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
            return  # reported as a type that the message cannot carry
        yield SimFault(
            code="OBK304",
            severity="error",
            path=path,
            message=f"sensor `{name}` is declared as `{written}`, but in the model it is "
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
    """Suggest similar names of sensors with the declared type, otherwise of any sensor."""
    near = near_names(name, same_type) or near_names(name, facts.sensors)
    return ask_for(near) or there_is(same_type or facts.sensors)


def _check_one_place(
    found: list[SensorFact], rule: GroupRule, path: SimPath, written: str
) -> Iterator[SimFault]:
    placed = [sensor for sensor in found if sensor.type in rule.takes]
    if rule.objects not in ("one site", "one object") or len(placed) < _ONE_PLACE:
        return
    kind = "site" if rule.objects == "one site" else "object"
    first, *others = placed
    for sensor in others:
        if (sensor.object_type, sensor.object_name) == (first.object_type, first.object_name):
            continue
        yield SimFault(
            code="OBK308",
            severity="error",
            path=(*path, "sensor_names", sensor.name),
            points_at="key",
            message=f"the sensors of `{written}` must be on the same {kind}: `{sensor.name}` is on "
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
    frames = (DEFAULT_FRAME, *facts.sites, *facts.bodies, *facts.geoms, *facts.cameras)
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


_COARSE_TIME_STEP_S = 0.02


def check_sim(
    block: Mapping[str, Any], parameters: Mapping[str, Any], facts: ModelFacts | None
) -> tuple[SimFault, ...]:
    """Return all findings about a block; without a model, only those that need none.

    In `block`, `sensor_type` has been renamed to `msg_type`, and the contents of a `config_path`
    file are the value of `scan_config`; otherwise it has the keys of the language page.
    """
    shape = check_sim_shape(block)
    if shape:
        return shape
    faults: list[SimFault] = []
    for index, group in enumerate(block.get("sensor_settings") or ()):
        path = ("sensor_settings", index)
        faults += check_group_rule(group, path, facts)
        if facts is not None:
            faults += check_group_against_model(group, path, facts)
            faults += _check_period(group, path, block, facts)
    if facts is not None:
        faults += _check_viz_geoms(block.get("viz_geoms") or {}, facts)
        faults += _check_keyframe(parameters, facts)
        faults += _check_size_and_step(block, facts)
    return tuple(faults)


def is_time_step(seconds: float) -> bool:
    """Whether a model can be simulated with this time step [s]; times have a resolution of 1 ns."""
    return is_number(seconds, SHORTEST_PERIOD_S, LONGEST_PERIOD_S)


def _time_step(block: Mapping[str, Any], facts: ModelFacts) -> float:
    """Simulation step [s]: the config's if set, otherwise the model's."""
    written = block.get("time_step")
    return facts.timestep if written is None else float(written)


def _check_period(
    group: Mapping[str, Any], path: SimPath, block: Mapping[str, Any], facts: ModelFacts
) -> Iterator[SimFault]:
    """Report a period below the step, unless `_check_size_and_step` reports this step."""
    time_step_s = _time_step(block, facts)
    is_reported = time_step_s > _COARSE_TIME_STEP_S or not _is_faster(group, facts.timestep)
    if _is_faster(group, time_step_s) and not is_reported:
        yield SimFault(
            code="OBK215",
            severity="warning",
            path=(*path, "dt"),
            message=f"sensor period {group['dt']:g} s is shorter than the simulation step "
            f"{time_step_s:g} s, so the sensor publishes at every step",
            help=f"write `dt: {time_step_s:g}` or a multiple of it",
        )


def _is_faster(group: Mapping[str, Any], time_step_s: float) -> bool:
    return bool(group["dt"] < time_step_s * (1 - 1e-9))


def _check_viz_geoms(viz_geoms: Mapping[str, Any], facts: ModelFacts) -> Iterator[SimFault]:
    for name, written in viz_geoms.items():
        if name == "dt":
            continue
        path = ("viz_geoms", name)
        actual = facts.geoms.get(name)
        if actual is None:
            yield SimFault(
                code="OBK311",
                severity="warning",
                path=path,
                points_at="key",
                message=f"geom `{name}` is not in the model, so it is not shown",
                help=did_you_mean(name, facts.geoms),
                meant=sure_name(name, facts.geoms),
            )
        elif actual != written:
            yield SimFault(
                code="OBK312",
                severity="error",
                path=path,
                message=f"geom `{name}` is declared as `{written}`, but in the model it is "
                f"{with_article(actual)}",
                help=f"write `{name}: {actual}`",
                element=("geom", name),
            )


def _check_keyframe(parameters: Mapping[str, Any], facts: ModelFacts) -> Iterator[SimFault]:
    name = parameters.get("ic_keyframe")
    if isinstance(name, str) and name and name not in facts.keyframes:
        yield SimFault(
            code="OBK310",
            severity="error",
            path=("params", "ic_keyframe"),
            message=f"keyframe `{name}` is not in the model",
            help=did_you_mean(name, facts.keyframes) or "the model has no keyframe",
            meant=sure_name(name, facts.keyframes),
        )


def _check_size_and_step(block: Mapping[str, Any], facts: ModelFacts) -> Iterator[SimFault]:
    n_u = block.get("n_u")
    if n_u is not None and n_u != len(facts.actuators):
        yield SimFault(
            code="OBK503",
            severity="warning",
            path=("n_u",),
            message=f"`n_u` is {n_u}, but the model has "
            f"{with_number(len(facts.actuators), 'actuator')}; the model takes precedence",
            help=f"remove `n_u` or write {len(facts.actuators)}",
        )
    written = block.get("time_step")
    step_s = _time_step(block, facts)
    if written is None and not is_time_step(step_s):
        yield SimFault(
            code="OBK302",
            severity="error",
            path=("model_xml_path",),
            message=f"the model's time step is {step_s:g} s, so it cannot be simulated",
            help="correct `timestep` in the model's `option`, or set `time_step` here",
            element=("option", ""),
        )
        return
    is_other = written is not None and abs(written - facts.timestep) > 1e-12
    if step_s > _COARSE_TIME_STEP_S:
        model_step = f" (the model specifies {facts.timestep:g} s)" if is_other else ""
        yield SimFault(
            code="OBK316",
            severity="warning",
            path=("time_step",) if written is not None else ("model_xml_path",),
            message=f"a simulation step of {step_s:g} s is likely to be unstable{model_step}"
            f"{_published_every_step(block, step_s, 0.0)}",
            help=f"most models need {_COARSE_TIME_STEP_S:g} s or less",
        )
    elif written is not None and is_other:
        yield SimFault(
            code="OBK504",
            severity="warning",
            path=("time_step",),
            message=f"`time_step` is {written:g} s, but the model specifies {facts.timestep:g} s; "
            "the config takes precedence"
            f"{_published_every_step(block, step_s, facts.timestep)}",
            help="the original Obelisk ignores `time_step`; remove it to use the model's step",
            element=("option", ""),
        )


def _published_every_step(block: Mapping[str, Any], step_s: float, own_step_s: float) -> str:
    """Name the sensor groups that are faster than the step, but not faster than the model's own."""
    groups = block.get("sensor_settings") or ()
    topics = [
        group["topic"]
        for group in groups
        if _is_faster(group, step_s) and not _is_faster(group, own_step_s)
    ]
    return f"; {list_names(topics, most=3)} would be published at every step" if topics else ""
