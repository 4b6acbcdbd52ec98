"""The options of a launch: the part of the plan, the final state, the duration, the policies.

Options that change the plan of a simulated robot, such as `--render`, are checked and applied here.
"""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obelisk_spec.suggestions import did_you_mean, list_names
from obelisk_spec.values import ParameterValue
from obelisk_spec.video import VideoError, VideoSettings, read_video
from obk_cli.config.environment import ModelRead
from obk_cli.config.model import SIMULATOR_PACKAGE
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.launch.event_loop import Limits
from obk_cli.launch.process_groups import Share
from obk_cli.launch.transitions import Until
from obk_cli.optional_deps import require_extra, require_ros
from obk_cli.plan.plan import OnCrash, Plan, PlannedNode
from obk_cli.process.shared_memory import require_shared_memory
from obk_cli.record.recorder_job import RecordRequest

__all__ = [
    "KEPT_RUNS",
    "LaunchOptions",
    "RenderArguments",
    "is_only_clock",
    "require_libraries",
    "require_simulated_time",
    "simulated_robots",
    "with_render",
    "with_simulator_parameters",
]

KEPT_RUNS: Final = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """The decisions of the user who launches a stack."""

    config: str
    """The config's path, as shown to other terminals."""
    folder: Path
    """The working folder of the nodes."""
    share: Share
    """The part of the stack that runs here."""
    until: Until = "active"
    duration_s: float | None = None
    """How long the stack stays up [s]; None: until a stop is requested."""
    sim_duration_s: float | None = None
    """The same in simulated time [s]; needs a simulator that sets the time of the stack."""
    limits: Limits = field(default_factory=Limits)
    on_crash: OnCrash = "stop"
    """For nodes whose config sets none."""
    is_composed: bool = False
    """Whether nodes that can share a process do so."""
    strict_rates: bool = False
    """Whether the stack stops if an expected rate is missed."""
    replaces: bool = False
    """Whether conflicting launches are stopped."""
    allows_foreign: bool = False
    """Whether nodes outside the stack may publish on topics that move the robot."""
    recording: RecordRequest | None = None
    """What to record, by default the plan's topics; None: nothing."""
    kept_runs: int = KEPT_RUNS
    gated_executables: frozenset[tuple[str, str]] = frozenset()
    """Package and executable of programs known to create their node with `spin_obelisk`."""


def require_libraries(plan: Plan, share: Share) -> None:
    """Check that ROS 2 can be loaded, and MuJoCo if our simulator runs here.

    Raises:
        CommandFailedError: a library cannot be loaded.
    """
    require_ros()
    require_shared_memory()
    if any(robot.package == SIMULATOR_PACKAGE for robot in simulated_robots(plan, share)):
        require_extra("mujoco", "sim")


def with_simulator_parameters(
    plan: Plan, share: Share, parameters: Mapping[str, ParameterValue], option: str
) -> Plan:
    """The plan with these parameters set for every simulated robot that runs here.

    Args:
        plan: the whole stack.
        share: the part that runs here.
        parameters: override those of the config; if empty, the plan is unchanged.
        option: the option that needs them, for the message.

    Raises:
        MisuseError: no simulated robot runs here.
    """
    if not parameters:
        return plan
    meant = _require_simulated_robots(plan, share, option)
    return replace(
        plan,
        nodes=tuple(
            replace(node, parameters={**node.parameters, **parameters}) if node in meant else node
            for node in plan.nodes
        ),
    )


def require_simulated_time(plan: Plan, share: Share) -> None:
    """Check for `--sim-duration` that a simulator which runs here sets the time of the stack.

    Raises:
        MisuseError: no simulated robot runs here, or the stack runs on the wall clock.
    """
    _require_simulated_robots(plan, share, "--sim-duration")
    if not is_only_clock(plan, [node for node in plan.nodes if node.device in share.devices]):
        raise MisuseError(
            f"`--sim-duration`: `{plan.name}` does not run in simulated time",
            help=f"a stack with one robot of `{SIMULATOR_PACKAGE}` does unless it sets "
            "`use_sim_time: false`; `--duration` counts seconds of the wall clock",
        )


def is_only_clock(plan: Plan, here: Collection[PlannedNode]) -> bool:
    """Whether our simulator, among the nodes that run here, is the only clock of the stack."""
    clocks = [node for node in plan.nodes if node.model and node.parameters.get(USE_SIM_TIME)]
    return len(clocks) == 1 and clocks[0].package == SIMULATOR_PACKAGE and clocks[0] in here


def _require_simulated_robots(plan: Plan, share: Share, option: str) -> tuple[PlannedNode, ...]:
    robots = simulated_robots(plan, share)
    if not robots:
        where = f"on {', '.join(sorted(share.devices))}" if share.is_part else f"in `{plan.name}`"
        raise MisuseError(
            f"`{option}`: no simulated robot {where}",
            help="a robot is simulated if its node has a `sim` block and no `is_simulated: False`",
        )
    return robots


def simulated_robots(plan: Plan, share: Share) -> tuple[PlannedNode, ...]:
    """The simulated robots of a plan that run here."""
    here = (node for node in plan.nodes if node.device in share.devices)
    return tuple(node for node in here if node.model is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderArguments:
    """The options of `obk launch --render`; None: not given."""

    path: Path | None
    camera: str | None
    size: str | None
    rate_hz: int | None


def with_render(plan: Plan, share: Share, arguments: RenderArguments) -> Plan:
    """The plan with parameters that make its simulated robot record a video.

    Args:
        plan: the whole stack.
        share: the part that runs here.
        arguments: the options; without a file, nothing is recorded.

    Raises:
        MisuseError: unknown video format or camera, or not exactly one robot to record.
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
            raise MisuseError(f"`{option}` needs `--render FILE`")


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
    from obk_cli.workspace.model_reader import cache_folder, has_mujoco, read_model_once

    if not has_mujoco():
        return
    read = read_model_once(Path(model), cache_folder(os.environ))
    if isinstance(read, ModelRead) and camera not in read.facts.cameras:
        raise MisuseError(
            f"`--render-camera {camera}`: {model} has no such camera",
            help=did_you_mean(camera, read.facts.cameras) or "it has no named cameras",
        )


def _check_output(path: Path) -> None:
    if not path.parent.is_dir():
        raise CommandFailedError(f"{path}: the folder {path.parent} does not exist")
    if os.path.lexists(path):
        raise CommandFailedError(f"{path} already exists", help="choose another file")
