"""Read and check the simulator's configuration: the `sim` block and the real-time factor.

The inputs are ROS parameters and facts about the model. The outputs are all findings as sentences,
and a frozen `SimConfig`. Findings and their wording are the same as those of `obk validate`.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.geoms import GEOM_KINDS
from obelisk_py.core.sim.mujoco.noise import SensorNoise, typed_sensor_noise
from obelisk_py.core.sim.mujoco.raycast import RayCaster, typed_ray_caster
from obelisk_py.core.sim.mujoco.sensors import SENSOR_KINDS
from obelisk_spec.components import DEFAULT_HISTORY_DEPTH, SettingTextError, parse_mapping
from obelisk_spec.model import ModelFacts
from obelisk_spec.names import bare_name
from obelisk_spec.sim_block import (
    CLOCK_RATE,
    DEFAULT_STEPS_PER_VIZ,
    REALTIME_FACTOR,
    check_sim_shape,
    parameter_fault,
)
from obelisk_spec.sim_checks import check_sim
from obelisk_spec.suggestions import with_article
from obelisk_spec.values import PERIOD_RANGE, is_none, is_period

__all__ = [
    "DEFAULT_CLOCK_RATE_HZ",
    "PARAMETER",
    "SensorGroupConfig",
    "SimConfig",
    "clock_rate_hz_of",
    "findings_of",
    "not_given",
    "read_block",
    "realtime_factor_of",
    "typed_block",
]

PARAMETER: Final = "mujoco_setting"
"""The ROS parameter with the `sim` block."""
_DEFAULT_GEOMS_PERIOD_S: Final = 1.0
DEFAULT_CLOCK_RATE_HZ: Final = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorGroupConfig:
    """Sensors that are published in one message."""

    topic: str
    period_s: float
    """Simulation time between two messages [s]."""
    msg_type: str
    """Bare type name, a key of `SENSOR_KINDS`."""
    history_depth: int
    sensor_names: Mapping[str, str]
    """Sensor name -> MuJoCo sensor type."""
    rays: RayCaster | None
    """The ray caster, if any."""
    sensor_noise: SensorNoise


@dataclass(frozen=True, slots=True, kw_only=True)
class SimConfig:
    """Settings of the simulation."""

    time_step_s: float | None
    """Overrides the model's time step [s]; None keeps it."""
    groups: tuple[SensorGroupConfig, ...]
    geoms: Mapping[str, str]
    """Geom name -> geom type, a key of `GEOM_KINDS`."""
    geoms_period_s: float
    """Simulation time between two messages [s]."""
    steps_per_view: int
    """Steps between two states that viewers receive."""


def read_block(text: str) -> Mapping[str, Any]:
    """Parse the block.

    Raises:
        ObeliskConfigError: the block is missing or is not a mapping.
    """
    if not text.strip():
        raise ObeliskConfigError(
            f"the parameter `{PARAMETER}` is not set; it must contain the `sim` block of the config"
        )
    try:
        return parse_mapping(text)
    except SettingTextError as error:
        raise ObeliskConfigError(f"the parameter `{PARAMETER}`: {error}") from error


def not_given(value: object) -> bool:
    """Whether a value means "not set", which the config language writes as `None`."""
    return value in (None, "") or is_none(value)


def findings_of(
    block: Mapping[str, Any],
    parameters: Mapping[str, Any],
    facts: ModelFacts | None,
    warn: Callable[[str], None],
) -> list[str]:
    """Return the reasons why a block cannot be simulated, one sentence each.

    Args:
        block: the result of `read_block`.
        parameters: the node's user parameters (`ic_keyframe`).
        facts: facts about the model; None if the model could not be read.
        warn: called with findings that do not stop the simulator.
    """
    faults = check_sim(block, parameters, facts)
    for fault in faults:
        if fault.severity == "warning":
            warn(str(fault))
    errors = [str(fault) for fault in faults if fault.severity == "error"]
    return errors if check_sim_shape(block) else errors + _beyond_this_simulator(block)


def _beyond_this_simulator(block: Mapping[str, Any]) -> list[str]:
    """Return findings for parts of the config language that this simulator does not support."""
    found = [
        f"sensor_settings[{index}].msg_type: this simulator does not publish "
        f"`{group['msg_type']}`; it publishes {', '.join(SENSOR_KINDS)}"
        for index, group in enumerate(block.get("sensor_settings") or ())
        if bare_name(group["msg_type"]) not in SENSOR_KINDS
    ]
    geoms = block.get("viz_geoms") or {}
    found += [
        f"viz_geoms.{name}: {with_article(kind)} cannot be shown as a marker; expected one of: "
        f"{', '.join(GEOM_KINDS)}"
        for name, kind in geoms.items()
        if name != "dt" and kind not in GEOM_KINDS
    ]
    period = geoms.get("dt", _DEFAULT_GEOMS_PERIOD_S)
    if not is_period(period):
        found.append(f"viz_geoms.dt: {period!r}, expected {PERIOD_RANGE}")
    return found


def typed_block(block: Mapping[str, Any], model_geoms: Collection[str] = ()) -> SimConfig:
    """Convert a block without errors; geoms that the model lacks are omitted."""
    geoms = block.get("viz_geoms") or {}
    period_s = float(geoms.get("dt", _DEFAULT_GEOMS_PERIOD_S))
    time_step = block.get("time_step")
    return SimConfig(
        time_step_s=None if time_step is None else float(time_step),
        groups=tuple(_group(group) for group in block.get("sensor_settings") or ()),
        geoms={name: kind for name, kind in geoms.items() if name in model_geoms},
        geoms_period_s=period_s,
        steps_per_view=block.get("num_steps_per_viz") or DEFAULT_STEPS_PER_VIZ,
    )


def _group(group: Mapping[str, Any]) -> SensorGroupConfig:
    scan = group.get("scan_config")
    return SensorGroupConfig(
        topic=group["topic"],
        period_s=float(group["dt"]),
        msg_type=bare_name(group["msg_type"]),
        history_depth=group.get("history_depth") or DEFAULT_HISTORY_DEPTH,
        sensor_names=dict(group.get("sensor_names") or {}),
        rays=None if scan is None else typed_ray_caster(scan),
        sensor_noise=typed_sensor_noise(group),
    )


def realtime_factor_of(value: object) -> float:
    """Check the real-time factor: simulated time per wall time; 0 for as fast as possible.

    Raises:
        ObeliskConfigError: the value is invalid.
    """
    return _checked(REALTIME_FACTOR, value)


def clock_rate_hz_of(value: object) -> float:
    """Check the maximum rate of `/clock` [Hz of simulated time].

    Raises:
        ObeliskConfigError: the value is invalid.
    """
    return _checked(CLOCK_RATE, value)


def _checked(name: str, value: object) -> float:
    fault = parameter_fault(name, value)
    if fault is not None or not isinstance(value, int | float):
        raise ObeliskConfigError(f"the parameter {fault}")
    return float(value)
