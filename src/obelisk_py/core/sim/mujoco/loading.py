"""From the text of a `sim` block to a compiled model, or to everything that is wrong with it.

In: the text, the keyframe that the config asks for. Out: model, block and keyframe. Reads the
files of the model and of ray casters, and the environment where those name variables.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.block import (
    SimBlock,
    findings_of,
    not_given,
    read_block,
    typed_block,
)
from obelisk_py.core.sim.mujoco.model import DEFAULT_KEYFRAME, compile_model, find_file, load_spec
from obelisk_py.core.sim.mujoco.scans.files import with_ray_casters
from obelisk_spec.model import read_model_facts
from obelisk_spec.suggestions import did_you_mean

__all__ = ["LoadedModel", "check_keyframe", "load_model"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedModel:
    """A model that passed every check."""

    model: mujoco.MjModel
    block: SimBlock
    keyframe: str | None
    """Where a run starts; None: the model's own start."""


def load_model(
    text: str,
    *,
    keyframe: str,
    folder: Path,
    share_of: Callable[[str], Path | None],
    warn: Callable[[str], None],
) -> LoadedModel:
    """Read, check and compile.

    Args:
        text: the `sim` block.
        keyframe: the keyframe that was asked for; empty: `ic` if the model has it.
        folder: what a relative `model_xml_path` is relative to.
        share_of: share folder of a package, None if there is no such package.
        warn: takes the findings that do not stop the simulator.

    Raises:
        ObeliskConfigError: with all findings, one a line.
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
    block = typed_block(raw)
    default = DEFAULT_KEYFRAME if DEFAULT_KEYFRAME in facts.keyframes else None
    return LoadedModel(
        model=compile_model(spec, block.time_step_s), block=block, keyframe=keyframe or default
    )


def check_keyframe(model: mujoco.MjModel, name: str) -> None:
    """See whether a run can start at a keyframe; empty: where the one before did.

    Raises:
        ObeliskConfigError: the model has none of that name.
    """
    there = [model.key(number).name for number in range(model.nkey)]
    if name and name not in there:
        hint = did_you_mean(name, filter(None, there)) or "it has none"
        raise ObeliskConfigError(f"the keyframe `{name}` is not in the model; {hint}")


def _read_spec(
    raw: Mapping[str, Any], find: Callable[[str], Path]
) -> tuple[mujoco.MjSpec | None, list[str]]:
    """The model, or why there is none; neither where the block has no path to speak of."""
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
