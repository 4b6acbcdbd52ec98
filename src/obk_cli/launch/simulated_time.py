"""Give the processes of a launch one page of memory with the simulated time.

The page is a memfd, and each process has an eventfd that wakes it; all of them are inherited.
Nothing has a name in a folder, so nothing is left behind, however the launch ends.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from obelisk_spec.runtime_protocol import (
    CLOCK_PAGE,
    CLOCK_VARIABLE,
    USE_SIM_TIME,
    ClockDescriptors,
    clock_page_bytes,
)
from obk_cli.launch.options import SIMULATOR
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.processes import NodeCommand
from obk_cli.plan.plan import Plan

__all__ = ["with_clock_page"]


@contextmanager
def with_clock_page(
    plan: Plan, units: Sequence[Unit], commands: Mapping[str, NodeCommand]
) -> Iterator[Mapping[str, NodeCommand]]:
    """The commands of the units with a clock page, if our simulator runs here as the only clock.

    Otherwise processes use `/clock`, and the commands stay as they are.

    Args:
        plan: the whole stack.
        units: the processes that run here.
        commands: how they are started, by the name of the unit.
    """
    if not _simulator_runs_in(plan, units):
        yield commands
        return
    page = os.memfd_create(CLOCK_PAGE)
    os.ftruncate(page, clock_page_bytes(len(units)))
    wakes = tuple(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC) for _ in units)
    try:
        yield {
            unit.name: _inheriting(
                commands[unit.name], ClockDescriptors(page=page, own=own, wakes=wakes)
            )
            for own, unit in enumerate(units)
        }
    finally:
        for fd in (page, *wakes):
            os.close(fd)


def _simulator_runs_in(plan: Plan, units: Sequence[Unit]) -> bool:
    clocks = [node for node in plan.processes if node.model and node.parameters.get(USE_SIM_TIME)]
    here = [node for unit in units for node in unit.nodes]
    return len(clocks) == 1 and clocks[0].package == SIMULATOR and clocks[0] in here


def _inheriting(command: NodeCommand, descriptors: ClockDescriptors) -> NodeCommand:
    return replace(
        command,
        environment={**command.environment, CLOCK_VARIABLE: str(descriptors)},
        inherited=(descriptors.page, *descriptors.wakes),
    )
