"""Reject a stack with a real robot where only a simulated one may run."""

from collections.abc import Collection

from obk_cli.config.model import Stack
from obk_cli.errors import CommandFailedError

__all__ = ["refuse_hardware"]


def refuse_hardware(
    stack: Stack,
    why: str,
    help: str,
    *,
    may_be_unclear: bool = False,
    left_out: Collection[str] = (),
) -> None:
    """Reject a stack with a robot that is not simulated.

    Args:
        stack: the config.
        why: why hardware is rejected, the end of the error's sentence.
        help: what the user can do.
        may_be_unclear: accept a robot without `is_simulated` and without a `sim` block.
        left_out: full names of nodes that do not run.

    Raises:
        CommandFailedError: it has a robot that is hardware.
    """
    for robot in stack.section("robot"):
        said = robot.is_simulated
        if robot.full_name in left_out or robot.runs_simulation:
            continue
        if may_be_unclear if said is None else said.value:
            continue
        span = said.span if said else robot.span
        raise CommandFailedError(
            f"{span.path}:{span.line}:{span.column}: the robot {robot.full_name} is hardware, "
            f"and {why}",
            help=help,
        )
