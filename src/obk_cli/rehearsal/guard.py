"""What may be rehearsed at all: simulated robots only, and no stack that runs."""

from pathlib import Path

from obk_cli.adapters.live_runs import live_folders
from obk_cli.config.model import Stack
from obk_cli.errors import CommandFailedError

__all__ = ["refuse_hardware", "refuse_running"]


def refuse_hardware(stack: Stack) -> None:
    """Refuse a stack with a robot that no simulator stands in for.

    Raises:
        CommandFailedError: it has one.
    """
    robot = next((robot for robot in stack.section("robot") if not robot.runs_simulation), None)
    if robot is None:
        return
    span = robot.is_simulated.span if robot.is_simulated else robot.span
    raise CommandFailedError(
        f"{span.path}:{span.line}:{span.column}: the robot {robot.full_name} is hardware, and a "
        "rehearsal kills and freezes the nodes that control it",
        help="`is_simulated: true` and a `sim` block, in the config or by `--set`, simulate it",
    )


def refuse_running(runs: Path, name: str) -> None:
    """Refuse a stack that runs on this host, in whichever ROS domain.

    Args:
        runs: the folder of all runs.
        name: the config's.

    Raises:
        CommandFailedError: it runs.
    """
    other = next((run for run in live_folders(runs).values() if run.name == name), None)
    if other is not None:
        raise CommandFailedError(
            f"the stack `{name}` runs in the ROS domain {other.domain} (process {other.pid}), and "
            "a rehearsal beside it would disturb both",
            help=f"`obk stop {name}` ends it",
        )
