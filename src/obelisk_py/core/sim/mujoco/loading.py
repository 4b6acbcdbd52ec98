"""Load a model from the text of a `sim` block, or report every finding about it.

This reads the files of the model and of ray casters, and the environment variables that they use.
If a file is missing or MuJoCo rejects it, the `ObeliskConfigError` contains MuJoCo's message.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.sim_config import (
    SimConfig,
    findings_of,
    not_given,
    read_block,
    typed_block,
)
from obelisk_spec.model import read_model_facts
from obelisk_spec.suggestions import did_you_mean
from obelisk_spec.yaml_core import YamlTextError, expand_variables, load_yaml_core

__all__ = [
    "DEFAULT_KEYFRAME",
    "LoadedModel",
    "check_keyframe",
    "compile_model",
    "find_file",
    "load_model",
    "load_spec",
    "with_ray_casters",
]

DEFAULT_KEYFRAME: Final = "ic"
"""The initial keyframe if the config names none and the model has this one."""


def find_file(
    path: str, robot_pkg: str | None, folder: Path, share_of: Callable[[str], Path | None]
) -> Path:
    """Find a file of the sim block, first in `folder`, then in the package's `mujoco` folder.

    Args:
        path: absolute or relative path in the settings.
        robot_pkg: the `robot_pkg` setting; None if not set.
        folder: base of a relative path.
        share_of: returns the share folder of a package; None if the package does not exist.

    Raises:
        ObeliskConfigError: the file does not exist; the message lists the searched paths.
    """
    places = [folder / path]
    if robot_pkg is not None and not Path(path).is_absolute():
        share = share_of(robot_pkg)
        places += [share / "mujoco" / path] if share else []
    for place in places:
        if place.is_file():
            return place.resolve()
    tried = ", ".join(str(place) for place in places)
    unknown = robot_pkg is not None and len(places) == 1 and not Path(path).is_absolute()
    raise ObeliskConfigError(
        f"file not found: `{path}`; tried {tried}"
        + (f"; the package `{robot_pkg}` was not found either" if unknown else "")
    )


def load_spec(path: Path) -> mujoco.MjSpec:
    """Read an MJCF file without compiling it.

    Raises:
        ObeliskConfigError: MuJoCo cannot read it.
    """
    try:
        return mujoco.MjSpec.from_file(os.fsencode(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ObeliskConfigError(f"model_xml_path: MuJoCo rejects {path}: {error}") from error


def compile_model(spec: mujoco.MjSpec, time_step_s: float | None) -> mujoco.MjModel:
    """Compile a model, with autoreset off so that a divergence stays visible.

    Args:
        spec: the model.
        time_step_s: overrides the model's own time step [s].

    Raises:
        ObeliskConfigError: MuJoCo cannot compile the model.
    """
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ObeliskConfigError(f"model_xml_path: MuJoCo cannot compile it: {error}") from error
    if time_step_s is not None:
        model.opt.timestep = time_step_s
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def with_ray_casters(
    block: Mapping[str, Any], find: Callable[[str], Path], environment: Mapping[str, str]
) -> tuple[Mapping[str, Any], list[str]]:
    """Load the files of ray casters into a sim block, and list errors about these files.

    Args:
        block: the raw block; a malformed one is returned unchanged.
        find: returns the file for a path; raises ObeliskConfigError if it does not exist.
        environment: values for `${NAME}` in the files.
    """
    groups, errors = block.get("sensor_settings"), []
    if not isinstance(groups, list):
        return block, []
    filled = []
    for index, group in enumerate(groups):
        path = group.get("config_path") if isinstance(group, Mapping) else None
        if isinstance(path, str) and not group.get("scan_config"):
            try:
                group = {**group, "scan_config": _read_ray_caster(find(path), environment)}
            except ObeliskConfigError as error:
                errors.append(f"sensor_settings[{index}].config_path: {error}")
        filled.append(group)
    return {**block, "sensor_settings": filled}, errors


def _read_ray_caster(path: Path, environment: Mapping[str, str]) -> Mapping[str, Any]:
    expand = partial(expand_variables, environment=environment)
    try:
        value = load_yaml_core(path.read_text(encoding="utf-8"), expand)
    except (OSError, UnicodeDecodeError, YamlTextError) as error:
        raise ObeliskConfigError(f"{path} cannot be read: {error}") from error
    if isinstance(value, Mapping):
        value = value.get("scan_config", value)
    if not isinstance(value, Mapping):
        raise ObeliskConfigError(
            f"{path} is not a ray caster, expected a mapping with `site_name` and `pattern`"
        )
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedModel:
    """A compiled model that passed every check."""

    model: mujoco.MjModel
    config: SimConfig
    keyframe: str | None
    """The initial keyframe; None for the model's own initial state."""


def load_model(
    text: str,
    *,
    keyframe: str,
    folder: Path,
    share_of: Callable[[str], Path | None],
    warn: Callable[[str], None],
) -> LoadedModel:
    """Read, check and compile a model.

    Args:
        text: the `sim` block.
        keyframe: the requested keyframe; if empty, `ic` if the model has it.
        folder: base of a relative `model_xml_path`.
        share_of: returns the share folder of a package; None if the package does not exist.
        warn: called with findings that do not stop the simulator.

    Raises:
        ObeliskConfigError: the message contains all findings, one per line.
    """
    raw = read_block(text)
    package = raw.get("robot_pkg")
    package = None if not_given(package) else str(package)

    def find(path: str) -> Path:
        return find_file(path, package, folder, share_of)

    spec, errors = _read_spec(raw, find)
    raw, unreadable = with_ray_casters(raw, find, os.environ)
    errors += unreadable
    facts = None if spec is None else read_model_facts(spec)
    errors += findings_of(raw, {"ic_keyframe": keyframe} if keyframe else {}, facts, warn)
    if spec is None or facts is None or errors:
        raise ObeliskConfigError("the sim block cannot be simulated:\n" + "\n".join(errors))
    config = typed_block(raw, model_geoms=facts.geoms)
    default = DEFAULT_KEYFRAME if DEFAULT_KEYFRAME in facts.keyframes else None
    return LoadedModel(
        model=compile_model(spec, config.time_step_s), config=config, keyframe=keyframe or default
    )


def check_keyframe(model: mujoco.MjModel, name: str) -> None:
    """Check that a run can start at a keyframe; an empty name is valid.

    Raises:
        ObeliskConfigError: the model has no keyframe with this name.
    """
    keyframes = [model.key(number).name for number in range(model.nkey)]
    if name and name not in keyframes:
        hint = did_you_mean(name, filter(None, keyframes)) or "it has none"
        raise ObeliskConfigError(f"the keyframe `{name}` is not in the model; {hint}")


def _read_spec(
    raw: Mapping[str, Any], find: Callable[[str], Path]
) -> tuple[mujoco.MjSpec | None, list[str]]:
    """Return the model, or why it cannot be read; neither if the block has no valid path."""
    path = raw.get("model_xml_path")
    if not isinstance(path, str) or not path:
        return None, []
    try:
        found = find(path)
    except ObeliskConfigError as error:
        return None, [f"model_xml_path: {error}"]
    try:
        return load_spec(found), []
    except ObeliskConfigError as error:
        return None, [str(error)]
