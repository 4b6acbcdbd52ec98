"""A fake stack of three nodes, and observations of a launcher's reports about it."""

from pathlib import Path

from obk_cli.faultinject.expectations import Case, Fault, expectation_of
from obk_cli.faultinject.verdict import Observation, TimedEvent
from obk_cli.launch.events import OutputEvent
from obk_cli.launch.process_groups import Unit
from obk_cli.plan.plan import OnCrash, PlannedNode
from obk_cli.runs.protocol import NodeStatus, StackStatus

from ..plans import node  # noqa: TID252 - shared by folders of tests

ROBOT, ESTIMATOR, CONTROLLER = "/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0"
NODES = (CONTROLLER, ESTIMATOR, ROBOT)
INJECTED_S = 1000.0


def process(
    name: str, on_crash: OnCrash | None = None, *, has_lifecycle: bool = True
) -> PlannedNode:
    section = name.split("_")[1]
    return node(name.strip("/"), section, on_crash=on_crash, has_lifecycle=has_lifecycle)


def unit(*names: str) -> Unit:
    name = names[0] if len(names) == 1 else "/s/composed"
    return Unit(name=name, nodes=tuple(map(process, names)))


def case(fault: Fault, on_crash: OnCrash, *names: str) -> Case:
    hit = unit(*(names or (ROBOT,)))
    return Case(unit=hit, fault=fault, expectation=expectation_of(hit, fault, on_crash))


def status(
    *, states: dict[str, str] | None = None, pids: dict[str, int | None] | None = None
) -> StackStatus:
    """All nodes active with the process IDs 1, 2 and 3, except for given changes."""
    nodes = tuple(
        NodeStatus(
            node=node,
            section="",
            device="onboard",
            state=(states or {}).get(node, "active"),
            process=node,
            pid=(pids or {}).get(node, number),
            restarts=0,
            hangs=False,
        )
        for number, node in enumerate(NODES, start=1)
    )
    return StackStatus(name="s", state="active", phase="active", seconds=1.0, nodes=nodes)


def events(*reported: tuple[float, OutputEvent]) -> tuple[TimedEvent, ...]:
    """Events at these times after the fault [s]."""
    return tuple(
        TimedEvent(time_s=INJECTED_S + after_s, event=event) for after_s, event in reported
    )


def observation(
    *reported: tuple[float, OutputEvent],
    after: StackStatus | None = None,
    exit_code: int | None = None,
    ended_after_s: float | None = None,
    left: tuple[str, ...] = (),
) -> Observation:
    return Observation(
        injected_s=INJECTED_S,
        run=Path("runs/s"),
        before=status(),
        events=events(*reported),
        after=after,
        exit_code=exit_code,
        ended_s=None if ended_after_s is None else INJECTED_S + ended_after_s,
        left=left,
    )
