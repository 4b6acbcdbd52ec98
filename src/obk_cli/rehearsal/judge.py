"""Holds what was seen of a case against its promise. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from obk_cli.launch.events import (
    AnswersAgain,
    Ended,
    Failed,
    GoesOnWithout,
    Hung,
    ProcessEnded,
    ProcessStarted,
    Restarted,
    Restarting,
)
from obk_cli.rehearsal.cases import Case
from obk_cli.rehearsal.scene import Moment, Scene
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.protocol import StackStatus

__all__ = ["Row", "has_concluded", "judge", "not_whole"]

REACTIONS = (Hung, ProcessEnded, ProcessStarted, Restarting, GoesOnWithout, Failed, Ended)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """How a case went."""

    case: Case
    seen: str
    """In a few words, in those of the promise where they fit."""
    noticed_s: float | None = None
    """From the fault until the launcher told of it [s]; None: it did not."""
    settled_s: float | None = None
    """From the fault until the stack was back, down, or known to go on [s]."""
    faults: tuple[str, ...] = ()
    """Sentences on what is not as promised."""
    run: Path | None = None
    """The folder of the run; None where nothing could be started."""

    @property
    def is_right(self) -> bool:
        """Whether the promise was kept."""
        return not self.faults


def judge(case: Case, scene: Scene) -> Row:
    """How a case went."""
    return Row(
        case=case,
        seen=_seen(scene),
        noticed_s=_noticed_s(case, scene),
        settled_s=_settled_s(case, scene),
        faults=tuple(_faults(case, scene)),
        run=scene.run,
    )


def has_concluded(case: Case, moments: tuple[Moment, ...]) -> bool:
    """Whether the launcher has told what ends its reaction."""
    return any(_concludes(case, moment) for moment in moments)


def not_whole(status: StackStatus | None) -> Iterator[str]:
    """Sentences on what keeps a stack from being up and well."""
    if status is None:
        yield "the launcher does not answer"
        return
    for node in status.nodes:
        if node.pid is None:
            yield f"{node.node}: no process"
        elif node.hangs:
            yield f"{node.node}: it hangs"
        elif node.state not in (ACTIVE, ""):
            yield f"{node.node}: {node.state}, not active"


def _concludes(case: Case, moment: Moment) -> bool:
    names = set(case.unit.node_names)
    match case.promise.reaction, moment.event:
        case "stop", Ended():
            return True
        case "restart", Restarted(nodes=nodes):
            return not names.isdisjoint(nodes)
        case "go on", GoesOnWithout(nodes=nodes):
            return not names.isdisjoint(nodes)
        case _:
            return False


def _is_notice(case: Case, moment: Moment) -> bool:
    match moment.event:
        case ProcessEnded(process=process):
            return process == case.unit.name
        case Hung(node=node):
            return node in case.unit.node_names
        case _:
            return False


def _noticed_s(case: Case, scene: Scene) -> float | None:
    notices = (m.time_s for m in scene.moments if _is_notice(case, m))
    return next((time_s - scene.struck_s for time_s in notices), None)


def _settled_s(case: Case, scene: Scene) -> float | None:
    if case.promise.reaction == "stop":
        return None if scene.ended_s is None else scene.ended_s - scene.struck_s
    ends = (m.time_s for m in scene.moments if _concludes(case, m))
    return next((time_s - scene.struck_s for time_s in ends), None)


def _seen(scene: Scene) -> str:
    events = [moment.event for moment in scene.moments]
    if scene.exit_code is not None:
        return f"stack down, exit {scene.exit_code}"
    if any(isinstance(event, Ended) for event in events):
        return "stack down, the launcher still there"
    if any(isinstance(event, Restarted) for event in events):
        return "restarted" if any(not_whole(scene.after)) else "restarted, all active"
    if any(isinstance(event, Restarting) for event in events):
        return "restarting without end"
    if any(isinstance(event, GoesOnWithout) for event in events):
        return "the others run on"
    names = sorted({type(event).__name__ for event in events if isinstance(event, REACTIONS)})
    return f"only told: {', '.join(names)}" if names else "no reaction"


def _faults(case: Case, scene: Scene) -> Iterator[str]:
    if case.promise.reaction == "nothing":
        yield from _unwanted(scene)
    else:
        yield from _lateness(case, scene)
    match case.promise.reaction:
        case "stop":
            yield from _not_down(case, scene)
        case "restart":
            yield from _not_back(case, scene)
        case "go on":
            yield from _not_without(case, scene)
        case "nothing":
            yield from _not_as_before(case, scene, is_lost=False)
    yield from (f"left behind: {command}" for command in scene.left)


def _unwanted(scene: Scene) -> Iterator[str]:
    for moment in scene.moments:
        if isinstance(moment.event, REACTIONS):
            yield f"no reaction is right, this was one: {moment.event}"


def _lateness(case: Case, scene: Scene) -> Iterator[str]:
    noticed_s, settled_s = _noticed_s(case, scene), _settled_s(case, scene)
    limits = case.promise
    if noticed_s is None:
        yield "it was not noticed"
    elif noticed_s > limits.noticed_s:
        yield f"noticed after {noticed_s:.2f} s, promised within {limits.noticed_s:g} s"
    if settled_s is None:
        yield f"not so within {limits.settled_s:g} s: {limits.words}"
    elif settled_s > limits.settled_s:
        yield f"so after {settled_s:.1f} s, promised within {limits.settled_s:g} s: {limits.words}"


def _not_down(case: Case, scene: Scene) -> Iterator[str]:
    if scene.exit_code not in (1, None):
        yield f"exit code {scene.exit_code}, promised 1"
    ended = next((m.event for m in scene.moments if isinstance(m.event, Ended)), None)
    if ended is None:
        yield "the launcher told no end"
        return
    names = (case.unit.name, *case.unit.node_names)
    if not any(name in ended.cause for name in names):
        yield f"the cause names another one: {ended.cause}"
    places = [str(node.origin) for node in case.unit.nodes]
    if ended.origin not in places:
        yield f"the place in the config is another one: {ended.origin or 'none'}"


def _not_back(case: Case, scene: Scene) -> Iterator[str]:
    attempts = sum(isinstance(moment.event, Restarting) for moment in scene.moments)
    if attempts > 1:
        yield f"restarted {attempts} times, once is right"
    yield from _not_as_before(case, scene, is_lost=False)
    before, after = _pids(scene.before), _pids(scene.after)
    if after.get(case.unit.name) == before[case.unit.name]:
        yield f"{case.unit.name}: still the process that was hit"


def _not_without(case: Case, scene: Scene) -> Iterator[str]:
    yield from _not_as_before(case, scene, is_lost=case.fault == "kill")
    if case.fault == "freeze":
        back = {m.event.node for m in scene.moments if isinstance(m.event, AnswersAgain)}
        for node in case.unit.nodes:
            if node.has_lifecycle and node.full_name not in back:
                yield f"{node.full_name}: answers again, and that was not told"


def _not_as_before(case: Case, scene: Scene, *, is_lost: bool) -> Iterator[str]:
    """What has changed of the stack, those aside that it was done to."""
    if scene.exit_code is not None:
        yield "the stack came down"
        return
    hit = case.unit.node_names
    spared = tuple(f"{name}: " for name in hit) if is_lost else ()
    yield from (fault for fault in not_whole(scene.after) if not fault.startswith(spared))
    before, after = _pids(scene.before), _pids(scene.after)
    for process, pid in before.items():
        if process != case.unit.name and after.get(process) not in (None, pid):
            yield f"{process}: started anew, and it was not hit"


def _pids(status: StackStatus | None) -> dict[str, int | None]:
    return {node.process: node.pid for node in status.nodes} if status else {}
