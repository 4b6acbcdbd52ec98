"""Options of a launch for the simulated robots of a stack: parameters beyond the config."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from obelisk_spec.values import ParameterValue
from obk_cli.errors import MisuseError
from obk_cli.launch.process_groups import Share
from obk_cli.optional_deps import require_extra, require_ros
from obk_cli.plan.plan import Plan, Process
from obk_cli.process.shared_memory_check import require_shared_memory

__all__ = ["require_libraries", "simulated_robots", "with_simulator_parameters"]

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
