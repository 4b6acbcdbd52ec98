"""From a model's file to a compiled model that can be stepped.

In: a path and what the config overrides. Out: a MuJoCo spec, a compiled model. A file that is not
there or that MuJoCo refuses is an `ObeliskConfigError` with MuJoCo's own sentence.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["DEFAULT_KEYFRAME", "compile_model", "find_file", "load_spec", "reset_state"]

DEFAULT_KEYFRAME: Final = "ic"
"""The keyframe that a run starts from if the model has it and the config names none."""


def find_file(
    path: str, robot_pkg: str | None, folder: Path, share_of: Callable[[str], Path | None]
) -> Path:
    """A file of the sim block: absolute, else in `folder`, else in the package's `mujoco` folder.

    Args:
        path: as the settings have it.
        robot_pkg: `robot_pkg`, None where not given.
        folder: what a relative path is relative to.
        share_of: share folder of a package, None if there is no such package.

    Raises:
        ObeliskConfigError: it is in none of these places; the message lists them.
    """
    places = [folder / path]
    if robot_pkg is not None and not Path(path).is_absolute():
        share = share_of(robot_pkg)
        places += [share / "mujoco" / path] if share else []
    for place in places:
        if place.is_file():
            return place.resolve()
    looked = ", ".join(str(place) for place in places)
    unknown = robot_pkg is not None and len(places) == 1 and not Path(path).is_absolute()
    raise ObeliskConfigError(
        f"`{path}` is not there; looked for {looked}"
        + (f", and there is no package `{robot_pkg}`" if unknown else "")
    )


def load_spec(path: Path) -> mujoco.MjSpec:
    """Read an MJCF file without compiling it.

    Raises:
        ObeliskConfigError: MuJoCo cannot read it.
    """
    try:
        return mujoco.MjSpec.from_file(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ObeliskConfigError(f"model_xml_path: MuJoCo refuses {path}: {error}") from error


def compile_model(spec: mujoco.MjSpec, time_step_s: float | None) -> mujoco.MjModel:
    """Compile a model; autoreset is off, so that a divergence is seen and not wiped away.

    Args:
        spec: the model.
        time_step_s: overrides the model's own time step [s].

    Raises:
        ObeliskConfigError: MuJoCo cannot compile it.
    """
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ObeliskConfigError(f"model_xml_path: MuJoCo cannot compile it: {error}") from error
    if time_step_s is not None:
        model.opt.timestep = time_step_s
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def reset_state(model: mujoco.MjModel, data: mujoco.MjData, keyframe: str | None) -> None:
    """Put the state, and the control, to a keyframe or to the model's own start."""
    if keyframe is None:
        mujoco.mj_resetData(model, data)
    else:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    mujoco.mj_forward(model, data)
