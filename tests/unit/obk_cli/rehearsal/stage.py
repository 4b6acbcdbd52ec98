"""A stack of three nodes, and scenes of what a launcher told about it, for the tests of judging."""

from pathlib import Path

from obk_cli.launch.asks import NodeStatus, StackStatus
from obk_cli.launch.events import Told
from obk_cli.launch.units import Unit
from obk_cli.plan.plan import OnCrash, Process
from obk_cli.rehearsal.cases import Case
from obk_cli.rehearsal.promise import Fault, promise
from obk_cli.rehearsal.scene import Moment, Scene

from ..plans import node  # noqa: TID252 - shared by folders of tests

ROBOT, ESTIMATOR, CONTROLLER = "/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0"
NODES = (CONTROLLER, ESTIMATOR, ROBOT)
STRUCK_S = 1000.0


def process(name: str, on_crash: OnCrash | None = None, *, has_lifecycle: bool = True) -> Process:
    section = name.split("_")[1]
    return node(name.strip("/"), section, on_crash=on_crash, has_lifecycle=has_lifecycle)


def unit(*names: str) -> Unit:
    name = names[0] if len(names) == 1 else "/s/composed"
    return Unit(name=name, nodes=tuple(map(process, names)))


def case(fault: Fault, on_crash: OnCrash, *names: str) -> Case:
    hit = unit(*(names or (ROBOT,)))
    return Case(unit=hit, fault=fault, promise=promise(hit, fault, on_crash))


def status(
    *, states: dict[str, str] | None = None, pids: dict[str, int | None] | None = None
) -> StackStatus:
    """All active under the numbers 1, 2 and 3, but for what is given."""
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


def moments(*told: tuple[float, Told]) -> tuple[Moment, ...]:
    """Events at so many seconds after the fault."""
    return tuple(Moment(time_s=STRUCK_S + after_s, event=event) for after_s, event in told)


def scene(
    *told: tuple[float, Told],
    after: StackStatus | None = None,
    exit_code: int | None = None,
    ended_after_s: float | None = None,
    left: tuple[str, ...] = (),
) -> Scene:
    return Scene(
        struck_s=STRUCK_S,
        run=Path("runs/s"),
        before=status(),
        moments=moments(*told),
        after=after,
        exit_code=exit_code,
        ended_s=None if ended_after_s is None else STRUCK_S + ended_after_s,
        left=left,
    )
