"""Collect the files of a robot's model, so that a workspace has a self-contained copy.

The input is an MJCF or URDF file; the output is files in memory, with their paths in the
workspace's model folder. Missing sensors and actuators are added to the copy.
"""

import os
import shlex
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

from obelisk_spec.model import ModelFacts
from obelisk_spec.sim_checks import is_time_step
from obelisk_spec.suggestions import list_names
from obk_cli.config.environment import ModelFault, ModelRead
from obk_cli.errors import CommandFailedError
from obk_cli.files import explain_os_error
from obk_cli.scaffold.robot_model import (
    RobotModel,
    sensor_groups,
    supplement,
    unused_sensors,
)
from obk_cli.scaffold.templates import RenderedFile
from obk_cli.workspace.hold import find_hold
from obk_cli.workspace.model_reader import import_mujoco, mjcf_files, read_model_bounded
from obk_cli.workspace.package_index import PackageIndex

__all__ = ["ModelCopy", "copy_model"]

_FOLDER = PurePosixPath("model")
"""The model's folder in the workspace."""
_ASSETS = "assets"
"""Folder for the meshes of a URDF, within the model's folder."""
_USUAL_PERIOD_S = 0.002
_XACRO = "ros.org/wiki/xacro"
"""Part of the namespace of xacro elements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCopy:
    """A copied model in a workspace."""

    robot: RobotModel
    files: tuple[RenderedFile, ...]


def copy_model(path: Path, stack: str) -> ModelCopy:
    """Copy a model with its files, add missing sensors, and find a controller that holds its pose.

    Args:
        path: an MJCF or URDF file.
        stack: name of the stack, and of the file with the added elements.

    Raises:
        CommandFailedError: the file is not a model, or cannot be simulated or copied.
    """
    root = _parsed(path)
    _refuse_xacro(path, root)
    with tempfile.TemporaryDirectory(prefix="obk-model-") as name:
        folder = Path(name)
        if root is not None and root.tag == "robot":
            files, main = _from_urdf(path, root, folder)
        else:
            files, main = _from_mjcf(path)
        _write(folder, files)
        more = supplement(_read(folder / main, shown=_copy_of(path)).facts, main.name)
        if more is not None:
            main = _free_name(stack, main, files)
            files = {**files, main: more.text.encode()}
            _write(folder, {main: files[main]})
        facts = _read(folder / main, shown=_copy_of(path)).facts
        _require_robot(facts, path)
        period_s = _period(facts)
        hold = find_hold(folder / main, period_s, shown=str(path))
    sensors = sensor_groups(facts, (actuator.joint for actuator in hold.actuators))
    return ModelCopy(
        robot=RobotModel(
            path=str(_FOLDER / main),
            period_s=period_s,
            hold=hold,
            groups=sensors,
            added=more.added if more else "",
            unused=unused_sensors(facts, sensors),
        ),
        files=tuple(
            RenderedFile(path=_FOLDER / place, content=content) for place, content in files.items()
        ),
    )


def _require_robot(facts: ModelFacts, path: Path) -> None:
    if not is_time_step(facts.timestep):
        raise CommandFailedError(
            f"{path} cannot be simulated: its time step is {facts.timestep:g} s",
            help="correct `timestep` in its `option`",
        )
    if not {"hinge", "slide"} & set(facts.joints.values()):
        raise CommandFailedError(
            f"{path} has no hinge or slide joint with a name",
            help="messages contain the positions of hinges and slides; write your own robot node "
            "for other joints",
        )


def _parsed(path: Path) -> ElementTree.Element | None:
    """The XML tree; None if MuJoCo should report what is wrong with it."""
    try:
        return ElementTree.fromstring(path.read_bytes())
    except OSError as fault:
        raise CommandFailedError(f"`{path}` cannot be read: {explain_os_error(fault)}") from fault
    except (ElementTree.ParseError, ValueError):
        return None


def _refuse_xacro(path: Path, root: ElementTree.Element | None) -> None:
    if root is not None and any(_XACRO in element.tag for element in root.iter()):
        raise CommandFailedError(
            f"{path} is a xacro file; convert it to URDF first",
            help=f"xacro {shlex.quote(str(path))} > {path.name.partition('.')[0]}.urdf",
        )


def _copy_of(path: Path) -> str:
    return f"the copy of {path}"


def _read(path: Path, *, shown: str) -> ModelRead:
    read = read_model_bounded(path)
    fault = read if isinstance(read, ModelFault) else read.fault
    if fault is not None:
        place = f"{shown}:{fault.line}" if fault.line else shown
        message = fault.message.replace(f"{path.absolute().parent}{os.sep}", "")
        raise CommandFailedError(
            f"{place}: MuJoCo cannot read this file as a model: {message}",
            help=_help_for(fault.message, path),
        )
    assert isinstance(read, ModelRead)
    _require_files(read.missing_files, shown, f"in {path.parent}")
    return read


def _help_for(message: str, path: Path) -> str | None:
    if "decoder" in message:
        return "MuJoCo reads STL, OBJ and MSH meshes and PNG textures: convert the file"
    root = _parsed(path)
    if root is not None and root.tag in ("mujoco", "robot"):
        return None
    return "expected an MJCF file (`<mujoco>`) or a URDF file (`<robot>`)"


def _require_files(missing: Sequence[str], shown: str, where: str) -> None:
    if not missing:
        return
    is_one = len(missing) == 1
    raise CommandFailedError(
        f"{shown}: {'a file' if is_one else f'{len(missing)} files'} of the model "
        f"{'is' if is_one else 'are'} missing: {list_names(missing, most=3)}",
        help=f"searched {where}; meshes in a git clone may need `git lfs pull`",
    )


Files = Mapping[PurePosixPath, bytes]


def _from_mjcf(path: Path) -> tuple[Files, PurePosixPath]:
    """The unchanged files, keyed by path in their common folder, and the path of the main one."""
    for relative, _ in _read(path, shown=str(path)).referenced_files:
        if Path(relative).is_absolute():
            raise CommandFailedError(
                f"{path}: the model refers to the file {relative} by its absolute path",
                help="make the path relative to the model's file, so that the copy works too",
            )
    places = {place.absolute() for file in mjcf_files(path) for place in (file, *_assets(file))}
    normal = {Path(os.path.normpath(place)) for place in places}
    root = Path(os.path.commonpath([place.parent for place in normal]))
    files = {
        PurePosixPath(place.relative_to(root).as_posix()): _bytes(place) for place in sorted(normal)
    }
    main = Path(os.path.normpath(path.absolute())).relative_to(root)
    return files, PurePosixPath(main.as_posix())


def _assets(model: Path) -> Iterator[Path]:
    """The existing files that a model refers to, resolved against the model's folder."""
    read = read_model_bounded(model)
    for names in read.referenced_files if isinstance(read, ModelRead) else ():
        yield from (place for name in names if (place := model.parent / name).is_file())


def _from_urdf(path: Path, root: ElementTree.Element, folder: Path) -> tuple[Files, PurePosixPath]:
    """Convert a URDF and its meshes to MJCF, which supports actuators and sensors.

    Args:
        path: the URDF.
        root: its XML tree, which is modified.
        folder: where MuJoCo reads the modified URDF and the meshes.
    """
    compiler = root.find("mujoco/compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    written_folder = compiler.get("meshdir", "")
    compiler.set("meshdir", _ASSETS)
    compiler.set("strippath", "true")
    named = dict.fromkeys(mesh.get("filename", "") for mesh in root.iter("mesh"))
    packages = _packages_around(path)
    meshes = {name: _mesh_file(name, path, written_folder, packages) for name in named}
    copies = _copy_names(named)
    for mesh in root.iter("mesh"):
        mesh.set("filename", copies[mesh.get("filename", "")])
    assets = {
        PurePosixPath(_ASSETS, copies[name]): _bytes(file) for name, file in meshes.items() if file
    }
    source = folder / path.name
    _write(folder, {**assets, PurePosixPath(path.name): ElementTree.tostring(root)})
    lost = [name for name in named if meshes[name] is None]
    wanted = {Path(file).name for file in _missing(source)}
    _require_files(
        [name for name in lost if copies[name] in wanted],
        str(path),
        f"in {path.parent}, in the packages of its workspace and in those on AMENT_PREFIX_PATH",
    )
    read = _read(source, shown=str(path))
    used = {PurePosixPath(relative) for relative, _ in read.referenced_files}
    spec: Any = import_mujoco().MjSpec.from_file(os.fsencode(source))
    main = PurePosixPath(f"{path.stem}.xml")
    return {main: spec.to_xml().encode(), **{p: assets[p] for p in used}}, main


def _missing(path: Path) -> tuple[str, ...]:
    read = read_model_bounded(path)
    return read.missing_files if isinstance(read, ModelRead) else ()


def _copy_names(meshes: Iterable[str]) -> dict[str, str]:
    """Mesh name in the URDF -> its name in the folder shared by meshes of all packages."""
    copies: dict[str, str] = {}
    for name in meshes:
        stem, suffix = Path(name).stem, Path(name).suffix
        free = chain([f"{stem}{suffix}"], (f"{stem}_{number}{suffix}" for number in count(2)))
        copies[name] = next(one for one in free if one not in copies.values())
    return copies


def _packages_around(path: Path) -> PackageIndex:
    parents = path.resolve().parents
    own = next((parent for parent in parents if (parent / "package.xml").is_file()), parents[0])
    return PackageIndex.around(own, own, os.environ)


def _mesh_file(name: str, path: Path, folder: str, packages: PackageIndex) -> Path | None:
    """The file of a URDF's mesh: in the package that it names, or relative to the URDF's folder."""
    scheme, _, rest = name.rpartition("://")
    if scheme == "package":
        package, _, rest = rest.partition("/")
        around = (parent for parent in path.resolve().parents if _is_package(parent, package))
        share = packages.find_package_share(package)
        places = tuple(parent / rest for parent in (*around, *([share] if share else [])))
    else:
        places = (path.parent / folder / Path(rest).name, path.parent / rest)
    return next((place for place in places if place.is_file()), None)


def _is_package(folder: Path, name: str) -> bool:
    """Whether this is the folder of a ROS package with this name."""
    if folder.name == name:
        return True
    manifest = folder / "package.xml"
    root = _parsed(manifest) if manifest.is_file() else None
    return root is not None and (root.findtext("name") or "").strip() == name


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as fault:
        raise CommandFailedError(f"`{path}` cannot be read: {explain_os_error(fault)}") from fault


def _free_name(stack: str, main: PurePosixPath, files: Iterable[PurePosixPath]) -> PurePosixPath:
    """An unused file name in the model's folder, where MuJoCo looks for assets."""
    taken = set(files)
    names = (main.with_name(f"{stack}{suffix}.xml") for suffix in ("", "_model", "_robot"))
    return next(name for name in names if name not in taken)


def _write(folder: Path, files: Files) -> None:
    for place, content in files.items():
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _period(facts: ModelFacts) -> float:
    """About 2 ms, as a whole number of simulation steps [s]."""
    steps = max(1, round(_USUAL_PERIOD_S / facts.timestep))
    return float(f"{steps * facts.timestep:.6g}")
