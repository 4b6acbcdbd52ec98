"""The options of `obk launch --render`, checked before anything starts."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from obelisk_spec.suggestions import did_you_mean, list_names
from obelisk_spec.values import ParameterValue
from obelisk_spec.video import VideoError, VideoSettings, read_video
from obk_cli.config.environment import ModelRead
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.launch.options import simulated_robots, with_simulator_parameters
from obk_cli.launch.process_groups import Share
from obk_cli.optional_deps import require_extra
from obk_cli.plan.plan import Plan

__all__ = [
    "RenderArguments",
    "RenderCameraOption",
    "RenderFpsOption",
    "RenderOption",
    "RenderSizeOption",
    "with_render",
]

RenderOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Film the simulated robot: .mp4, .gif, or .png at the end."),
]
RenderCameraOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="A camera of the model; else all of it is seen."),
]
RenderSizeOption = Annotated[
    str | None, typer.Option(metavar="WxH", help="Pixels; else as the camera has it, or 640x480.")
]
RenderFpsOption = Annotated[
    int | None,
    typer.Option(metavar="N", help="Frames per simulated second; else 30, a GIF 15."),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderArguments:
    """The options as given; None: not given."""

    path: Path | None
    camera: str | None
    size: str | None
    rate_hz: int | None


def with_render(plan: Plan, share: Share, arguments: RenderArguments) -> Plan:
    """The plan with parameters that make its simulated robot record a video.

    Args:
        plan: a whole stack.
        share: what of it runs here.
        words: the film; without a file none.

    Raises:
        MisuseError: there is no such film, no such camera, or not one robot to film.
        CommandFailedError: the file cannot be written, or a library is missing.
    """
    if arguments.path is None:
        _require_render(arguments)
        return plan
    settings = _settings(arguments.path, arguments)
    path = Path.cwd() / settings.path
    parameters: dict[str, ParameterValue] = {
        "render": str(path),
        "render_camera": arguments.camera or "",
        "render_size": arguments.size or "",
        "render_fps": arguments.rate_hz or 0,
    }
    rendered = with_simulator_parameters(plan, share, parameters, f"--render {arguments.path}")
    robot, *others = simulated_robots(plan, share)
    if others:
        names = list_names(node.full_name for node in (robot, *others))
        raise MisuseError(
            f"`--render {arguments.path}`: several simulated robots run here: {names}",
            help="give one of them the parameter `render` in the config",
        )
    if settings.camera is not None and robot.model is not None:
        _check_camera(robot.model, settings.camera)
    _check_output(path)
    for module in ("av", "PIL"):
        require_extra(module, "render")
    return rendered


def _require_render(arguments: RenderArguments) -> None:
    options = {
        "--render-camera": arguments.camera,
        "--render-size": arguments.size,
        "--render-fps": arguments.rate_hz,
    }
    for option, value in options.items():
        if value is not None:
            raise MisuseError(f"`{option}` says how a film is made; `--render FILE` asks for one")


def _settings(path: Path, arguments: RenderArguments) -> VideoSettings:
    if arguments.rate_hz is not None and arguments.rate_hz < 1:
        raise MisuseError(f"`--render-fps {arguments.rate_hz}`: expected a number of at least 1")
    try:
        return read_video(
            str(path), arguments.camera or "", arguments.size or "", arguments.rate_hz or 0
        )
    except VideoError as error:
        raise MisuseError(f"`--render`: {error}") from error


def _check_camera(model: str, camera: str) -> None:
    from obk_cli.workspace.model_cache import cache_folder, read_model_once
    from obk_cli.workspace.model_reader import has_mujoco

    if not has_mujoco():
        return
    read = read_model_once(Path(model), cache_folder(os.environ))
    if isinstance(read, ModelRead) and camera not in read.facts.cameras:
        raise MisuseError(
            f"`--render-camera {camera}`: {model} has no such camera",
            help=did_you_mean(camera, read.facts.cameras) or "it has none with a name",
        )


def _check_output(path: Path) -> None:
    if not path.parent.is_dir():
        raise CommandFailedError(f"{path}: the folder {path.parent} is not there")
    if os.path.lexists(path):
        raise CommandFailedError(f"{path} is there already", help="name another file")
