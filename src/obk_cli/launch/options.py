"""The options of a launch: which part of a plan, how far, how long, what follows from failures."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from obelisk_spec.values import ParameterValue
from obk_cli.errors import MisuseError
from obk_cli.launch.event_loop import Limits
from obk_cli.launch.process_groups import Share
from obk_cli.launch.transitions import Until
from obk_cli.optional_deps import require_extra, require_ros
from obk_cli.plan.plan import OnCrash, Plan, Process
from obk_cli.process.shared_memory import require_shared_memory
from obk_cli.record.recorder_job import RecordRequest

__all__ = [
    "KEPT_RUNS",
    "LaunchOptions",
    "require_libraries",
    "simulated_robots",
    "with_simulator_parameters",
]

KEPT_RUNS: Final = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """The decisions of the user who launches a stack."""

    config: str
    """The config's path, shown to other terminals."""
    folder: Path
    """The working folder of the nodes."""
    share: Share
    """The part of the stack that runs here."""
    until: Until = "active"
    duration_s: float | None = None
    """How long the stack stays up [s]; None: until a stop is requested."""
    limits: Limits = field(default_factory=Limits)
    on_crash: OnCrash = "stop"
    """For nodes whose config sets none."""
    is_composed: bool = False
    """Whether the nodes that can share one process do."""
    strict_rates: bool = False
    """Whether the stack comes down for an expected rate that is broken."""
    replaces: bool = False
    """Whether conflicting launches are ended."""
    allows_foreign: bool = False
    """Whether nodes outside the stack may publish on the topics that move the robot."""
    recording: RecordRequest | None = None
    """What is recorded; without topics and patterns those of the plan. None: nothing."""
    kept_runs: int = KEPT_RUNS
    gated_executables: frozenset[tuple[str, str]] = frozenset()
    """Package and executable of programs whose node `spin_obelisk` makes, as far as is known."""


SIMULATOR: Final = "obelisk_sim_py"
"""The package whose node runs in this very environment."""


def require_libraries(plan: Plan, share: Share) -> None:
    """Make sure that ROS 2 can be loaded, and MuJoCo if our simulator is to run.

    Raises:
        CommandFailedError: one of them is not.
    """
    require_ros()
    require_shared_memory()
    if any(robot.package == SIMULATOR for robot in simulated_robots(plan, share)):
        require_extra("mujoco", "sim")


def with_simulator_parameters(
    plan: Plan, share: Share, parameters: Mapping[str, ParameterValue], option: str
) -> Plan:
    """The plan with these parameters of every simulated robot that runs here.

    Args:
        plan: a whole stack.
        share: what of it runs here.
        parameters: they win over those of the config; none: the plan stays as it is.
        option: what asks for them, for the message.

    Raises:
        MisuseError: no simulated robot runs here.
    """
    if not parameters:
        return plan
    meant = simulated_robots(plan, share)
    if not meant:
        where = f"on {', '.join(sorted(share.devices))}" if share.is_part else f"in `{plan.name}`"
        raise MisuseError(
            f"`{option}`: there is no simulated robot {where}",
            help="a robot is simulated if its node has a `sim` block and no `is_simulated: False`",
        )
    return replace(
        plan,
        processes=tuple(
            replace(node, parameters={**node.parameters, **parameters}) if node in meant else node
            for node in plan.processes
        ),
    )


def simulated_robots(plan: Plan, share: Share) -> tuple[Process, ...]:
    """The simulated robots of a plan that run here."""
    here = (node for node in plan.processes if node.device in share.devices)
    return tuple(node for node in here if node.model is not None)
