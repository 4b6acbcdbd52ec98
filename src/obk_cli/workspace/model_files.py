"""Collect the files of a robot's model, so that a workspace has a copy that stands alone.

In: an MJCF or URDF file. Out: files in memory, by their paths in the model's folder of the
workspace. The copy, with what the model lacks, is read once more before it is handed on.
"""

import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

from obelisk_spec.model import ModelFacts
from obelisk_spec.suggestions import list_names
from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.errors import CommandFailedError
from obk_cli.optional_deps import require_extra
from obk_cli.scaffold.robot_model import RobotModel, sensor_groups, supplement_text
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.workspace.hold import find_hold
from obk_cli.workspace.model_reader import import_mujoco, mjcf_files, read_model_bounded

__all__ = ["ModelCopy", "copy_model"]

_FOLDER = PurePosixPath("model")
"""Of the workspace."""
_ASSETS = "assets"
"""The folder of the meshes of a URDF, below the model's."""
_USUAL_PERIOD_S = 0.002


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCopy:
    """A model in a workspace."""

    robot: RobotModel
    files: tuple[RenderedFile, ...]
    added: str
    """The file with what the model lacks, from the workspace; empty if it lacks nothing."""


def copy_model(path: Path, stack: str) -> ModelCopy:
    """Copy a model with its files, add the sensors that it lacks, and find a law that holds it.

    Args:
        path: an MJCF or URDF file.
        stack: its name; that of the file with what the model lacks.

    Raises:
        CommandFailedError: the file is no model, or one that cannot be simulated or copied.
    """
    require_extra("mujoco", "sim")
    is_urdf = _root_tag(path) == "robot"
    read = _read(path, shown=str(path))
    files, main = _urdf_files(path) if is_urdf else _mjcf_copies(path, read)
    added = _free_name(stack, main, files)
    with tempfile.TemporaryDirectory(prefix="obk-model-") as name:
        folder = Path(name)
        _write(folder, files)
        supplement = supplement_text(read.facts, main.name)
        if supplement is not None:
            files = {**files, added: supplement.encode()}
            _write(folder, {added: files[added]})
            main = added
        facts = _read(folder / main, shown=f"the copy of {path}").facts
        period_s = _period(facts)
        hold = find_hold(folder / main, period_s, shown=str(path))
    groups = sensor_groups(facts, (actuator.joint for actuator in hold.actuators))
    return ModelCopy(
        robot=RobotModel(path=str(_FOLDER / main), period_s=period_s, hold=hold, groups=groups),
        files=tuple(
            RenderedFile(path=_FOLDER / place, content=content) for place, content in files.items()
        ),
        added="" if supplement is None else str(_FOLDER / added),
    )


def _root_tag(path: Path) -> str:
    try:
        return ElementTree.parse(path).getroot().tag
    except OSError as fault:
        raise CommandFailedError(f"{path} cannot be read: {fault.strerror}") from fault
    except (ElementTree.ParseError, ValueError):
        return ""  # MuJoCo names the place


def _read(path: Path, *, shown: str) -> ModelRead:
    read = read_model_bounded(path)
    fault = read if isinstance(read, ModelFault) else read.fault
    if fault is not None:
        place = f"{shown}:{fault.line}" if fault.line else shown
        raise CommandFailedError(
            f"{place}: MuJoCo cannot read it as a model: {fault.message}",
            help="an MJCF file (`<mujoco>`) or a URDF file (`<robot>`) was expected",
        )
    assert isinstance(read, ModelRead)
    if read.missing_files:
        count = len(read.missing_files)
        raise CommandFailedError(
            f"{shown}: {'a file' if count == 1 else f'{count} files'} of the model "
            f"{'is' if count == 1 else 'are'} missing: {list_names(read.missing_files, most=3)}",
            help=f"they were looked for from {path.parent}; meshes of a clone may need `git lfs "
            "pull`",
        )
    return read


Files = Mapping[PurePosixPath, bytes]


def _mjcf_copies(path: Path, read: ModelRead) -> tuple[Files, PurePosixPath]:
    """The model's files as they are, from the folder around all of them."""
    folder = path.parent
    places = {file.absolute() for file in mjcf_files(path)}
    for relative, written in read.referenced_files:
        candidates = (folder / relative, folder / written)
        places |= {file.absolute() for file in candidates if os.path.isfile(file)}  # noqa: PTH113
        if Path(relative).is_absolute():
            raise CommandFailedError(
                f"{path}: the model names the file {relative} by its absolute path",
                help="write it relative to the model's file, so that the copy finds its own",
            )
    normal = {Path(os.path.normpath(place)) for place in places}
    root = Path(os.path.commonpath([place.parent for place in normal]))
    files = {
        PurePosixPath(place.relative_to(root).as_posix()): _bytes(place) for place in sorted(normal)
    }
    main = Path(os.path.normpath(path.absolute())).relative_to(root)
    return files, PurePosixPath(main.as_posix())


def _urdf_files(path: Path) -> tuple[Files, PurePosixPath]:
    """A URDF as MJCF, which has a place for actuators and sensors, and its meshes."""
    spec: Any = import_mujoco().MjSpec.from_file(str(path))
    folder = path.parent / spec.compiler.meshdir
    files: dict[PurePosixPath, bytes] = {}
    for mesh in spec.meshes:
        name = Path(mesh.file).name
        files[PurePosixPath(_ASSETS, name)] = _bytes(folder / mesh.file)
        mesh.file = name
    spec.compiler.meshdir = _ASSETS
    main = PurePosixPath(f"{path.stem}.xml")
    return {main: spec.to_xml().encode(), **files}, main


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as fault:
        raise CommandFailedError(f"{path} cannot be read: {fault.strerror}") from fault


def _free_name(stack: str, main: PurePosixPath, files: Iterable[PurePosixPath]) -> PurePosixPath:
    """Beside the model's file, from where MuJoCo looks for assets."""
    taken = set(files)
    names = (main.with_name(f"{stack}{suffix}.xml") for suffix in ("", "_model", "_robot"))
    return next(name for name in names if name not in taken)


def _write(folder: Path, files: Files) -> None:
    for place, content in files.items():
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _period(facts: ModelFacts) -> float:
    """About 2 ms, in whole steps of the simulation [s]."""
    steps = max(1, round(_USUAL_PERIOD_S / facts.timestep))
    return float(f"{steps * facts.timestep:.6g}")
