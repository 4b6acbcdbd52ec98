"""Every check of a `sim` block: called by the tool before a launch and by the simulator at
configure, so that both say the same.

A block, the node's parameters and the facts of a model in; findings out. Reads no file.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from obelisk_spec.model import ModelFacts
from obelisk_spec.sim_faults import SimFault, SimPath
from obelisk_spec.sim_groups import check_group_against_model, check_group_rule
from obelisk_spec.sim_shape import check_sim_shape
from obelisk_spec.suggestions import did_you_mean, sure_name
from obelisk_spec.wording import with_article, with_number

__all__ = ["SimFault", "SimPath", "check_sim"]

_COARSE_TIME_STEP_S = 0.02


def check_sim(
    block: Mapping[str, Any], parameters: Mapping[str, Any], facts: ModelFacts | None
) -> tuple[SimFault, ...]:
    """All findings about a block; without a model (`facts` None) those that need none.

    `block` has the keys of the language page with `sensor_type` already read as `msg_type` and
    the file of a `config_path` already put in place as `scan_config`.
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
            faults += _check_period(group, path, _time_step(block, facts))
    if facts is not None:
        faults += _check_viz_geoms(block.get("viz_geoms") or {}, facts)
        faults += _check_keyframe(parameters, facts)
        faults += _check_size_and_step(block, facts)
    return tuple(faults)


def _time_step(block: Mapping[str, Any], facts: ModelFacts) -> float:
    """The step that the simulation takes [s]: the config's, else the model's."""
    written = block.get("time_step")
    return facts.timestep if written is None else float(written)


def _check_period(
    group: Mapping[str, Any], path: SimPath, time_step_s: float
) -> Iterator[SimFault]:
    if group["dt"] < time_step_s * (1 - 1e-9):
        yield SimFault(
            code="OBK215",
            severity="warning",
            path=(*path, "dt"),
            message=f"sensor period {group['dt']:g} s is shorter than the simulation step "
            f"{time_step_s:g} s, so it is published every step",
            help=f"write `dt: {time_step_s:g}` or a multiple of it",
        )


def _check_viz_geoms(viz_geoms: Mapping[str, Any], facts: ModelFacts) -> Iterator[SimFault]:
    for name, written in viz_geoms.items():
        if name == "dt":
            continue
        path = ("viz_geoms", name)
        actual = facts.geoms.get(name)
        if actual is None:
            yield SimFault(
                code="OBK311",
                severity="error",
                path=path,
                points_at="key",
                message=f"geom `{name}` is not in the model",
                help=did_you_mean(name, facts.geoms),
                meant=sure_name(name, facts.geoms),
            )
        elif actual != written:
            yield SimFault(
                code="OBK312",
                severity="error",
                path=path,
                message=f"geom `{name}` is written as `{written}`, in the model it is "
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
    if n_u is not None and n_u != facts.actuators:
        yield SimFault(
            code="OBK503",
            severity="warning",
            path=("n_u",),
            message=f"`n_u` is {n_u}, the model has {with_number(facts.actuators, 'actuator')}; "
            "the model wins",
            help=f"leave `n_u` out or write {facts.actuators}",
        )
    written = block.get("time_step")
    if written is not None and abs(written - facts.timestep) > 1e-12:
        yield SimFault(
            code="OBK504",
            severity="warning",
            path=("time_step",),
            message=f"`time_step` is {written:g} s, the model says {facts.timestep:g} s; the "
            "config wins",
            element=("option", ""),
        )
    step_s = _time_step(block, facts)
    if step_s > _COARSE_TIME_STEP_S:
        yield SimFault(
            code="OBK316",
            severity="warning",
            path=("time_step",) if written is not None else ("model_xml_path",),
            message=f"a simulation step of {step_s:g} s is likely to be unstable",
            help=f"most models need {_COARSE_TIME_STEP_S:g} s or less",
        )
