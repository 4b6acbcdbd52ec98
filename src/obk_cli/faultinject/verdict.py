"""Compare the observation of a case with its expectation. Pure."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from obk_cli.faultinject.expectations import Case
from obk_cli.launch.events import (
    OUTPUT_EVENTS,
    AnswersAgain,
    Ended,
    Failed,
    GoesOnWithout,
    Hung,
    OutputEvent,
    ProcessEnded,
    ProcessStarted,
    Restarted,
    Restarting,
)
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.protocol import StackStatus

__all__ = [
    "Observation",
    "TimedEvent",
    "Verdict",
    "has_concluded",
    "incompleteness",
    "parse_event",
    "verdict_of",
]

_EVENTS: Final[Mapping[str, Any]] = OUTPUT_EVENTS


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedEvent:
    """An event and the time at which the launcher reported it."""

    time_s: float
    """[s since 1970]"""
    event: OutputEvent


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """Everything that was observed in one case."""

    injected_s: float
    """When the fault was injected [s since 1970]."""
    run: Path
    """The run folder of the launch."""
    before: StackStatus
    events: tuple[TimedEvent, ...]
    """Events since the fault."""
    after: StackStatus | None
    """None: the launcher does not respond, or has exited."""
    exit_code: int | None
    """The launcher's exit code; None while it is running."""
    ended_s: float | None = None
    """When the launcher was seen to have exited [s since 1970]."""
    left: tuple[str, ...] = ()
    """Commands of the processes that outlived their launcher."""


def parse_event(line: str) -> TimedEvent | None:
    """A line of `obk launch --format json`; None if it is not an event."""
    try:
        record = json.loads(line)
    except ValueError:
        return None
    if not isinstance(record, dict) or record.get("event") not in _EVENTS:
        return None
    time_s, kind = record.pop("time"), _EVENTS[record.pop("event")]
    values = {key: tuple(v) if isinstance(v, list) else v for key, v in record.items()}
    return TimedEvent(time_s=time_s, event=kind(**values))


REACTIONS = (Hung, ProcessEnded, ProcessStarted, Restarting, GoesOnWithout, Failed, Ended)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The result of a case."""

    case: Case
    observed: str
    """The reaction in a few words, the same as in the expectation if they match."""
    detected_s: float | None = None
    """From the fault until the launcher reported it [s]; None if it did not."""
    settled_s: float | None = None
    """From the fault until the stack was back, down, or known to continue [s]."""
    faults: tuple[str, ...] = ()
    """Deviations from the expectation."""
    run: Path | None = None
    """The folder of the run; None if nothing could be started."""

    @property
    def is_right(self) -> bool:
        """Whether the expectation was met."""
        return not self.faults


def verdict_of(case: Case, observation: Observation) -> Verdict:
    """Compare what was observed in a case with its expectation."""
    return Verdict(
        case=case,
        observed=_observed(observation),
        detected_s=_detected_s(case, observation),
        settled_s=_settled_s(case, observation),
        faults=tuple(_faults(case, observation)),
        run=observation.run,
    )


def has_concluded(case: Case, events: tuple[TimedEvent, ...]) -> bool:
    """Whether the launcher has reported that its reaction is complete."""
    return any(_concludes(case, event) for event in events)


def incompleteness(status: StackStatus | None) -> Iterator[str]:
    """The reasons why a stack is not complete and active."""
    if status is None:
        yield "the launcher does not respond"
        return
    for node in status.nodes:
        if node.pid is None:
            yield f"{node.node}: no process"
        elif node.hangs:
            yield f"{node.node}: hangs"
        elif node.state not in (ACTIVE, ""):
            yield f"{node.node}: {node.state}, not active"


def _concludes(case: Case, event: TimedEvent) -> bool:
    names = set(case.unit.node_names)
    match case.expectation.reaction, event.event:
        case "stop", Ended():
            return True
        case "restart", Restarted(nodes=nodes):
            return not names.isdisjoint(nodes)
        case "go on", GoesOnWithout(nodes=nodes):
            return not names.isdisjoint(nodes)
        case _:
            return False


def _is_notice(case: Case, event: TimedEvent) -> bool:
    match event.event:
        case ProcessEnded(process=process):
            return process == case.unit.name
        case Hung(node=node):
            return node in case.unit.node_names
        case _:
            return False


def _detected_s(case: Case, observation: Observation) -> float | None:
    notices = (m.time_s for m in observation.events if _is_notice(case, m))
    return next((time_s - observation.injected_s for time_s in notices), None)


def _settled_s(case: Case, observation: Observation) -> float | None:
    if case.expectation.reaction == "stop":
        return None if observation.ended_s is None else observation.ended_s - observation.injected_s
    ends = (m.time_s for m in observation.events if _concludes(case, m))
    return next((time_s - observation.injected_s for time_s in ends), None)


def _observed(observation: Observation) -> str:
    events = [event.event for event in observation.events]
    if observation.exit_code is not None:
        return f"stack down, exit {observation.exit_code}"
    if any(isinstance(event, Ended) for event in events):
        return "stack down, launcher still running"
    if any(isinstance(event, Restarted) for event in events):
        return "restarted" if any(incompleteness(observation.after)) else "restarted, all active"
    if any(isinstance(event, Restarting) for event in events):
        return "restarting, not restarted"
    if any(isinstance(event, GoesOnWithout) for event in events):
        return "other nodes keep running"
    names = sorted({type(event).__name__ for event in events if isinstance(event, REACTIONS)})
    return f"reported only: {', '.join(names)}" if names else "no reaction"


def _faults(case: Case, observation: Observation) -> Iterator[str]:
    if case.expectation.reaction == "nothing":
        yield from _unexpected(observation)
    else:
        yield from _lateness(case, observation)
    match case.expectation.reaction:
        case "stop":
            yield from _not_down(case, observation)
        case "restart":
            yield from _not_back(case, observation)
        case "go on":
            yield from _not_without(case, observation)
        case "nothing":
            yield from _not_as_before(case, observation, is_lost=False)
    yield from (f"left running: {command}" for command in observation.left)


def _unexpected(observation: Observation) -> Iterator[str]:
    for event in observation.events:
        if isinstance(event.event, REACTIONS):
            yield f"expected no reaction, but got: {event.event}"


def _lateness(case: Case, observation: Observation) -> Iterator[str]:
    detected_s, settled_s = _detected_s(case, observation), _settled_s(case, observation)
    limits = case.expectation
    if detected_s is None:
        yield "the fault was not detected"
    elif detected_s > limits.detected_s:
        yield f"detected after {detected_s:.2f} s, expected within {limits.detected_s:g} s"
    if settled_s is None:
        yield f"not settled within {limits.settled_s:g} s: {limits.summary}"
    elif settled_s > limits.settled_s:
        limit = f"within {limits.settled_s:g} s"
        yield f"settled after {settled_s:.1f} s, expected {limit}: {limits.summary}"


def _not_down(case: Case, observation: Observation) -> Iterator[str]:
    if observation.exit_code not in (1, None):
        yield f"exit code {observation.exit_code}, expected 1"
    ended = next((m.event for m in observation.events if isinstance(m.event, Ended)), None)
    if ended is None:
        yield "the launcher did not report that the run had ended"
        return
    names = (case.unit.name, *case.unit.node_names)
    if not any(name in ended.cause for name in names):
        yield f"the reported cause names another node: {ended.cause}"
    places = [str(node.origin) for node in case.unit.nodes]
    # Nothing shows which node of a shared process is at fault.
    if ended.origin not in (places if len(places) == 1 else ["", *places]):
        yield f"the reported location is not that of the node: {ended.origin or 'none'}"


def _not_back(case: Case, observation: Observation) -> Iterator[str]:
    attempts = sum(isinstance(event.event, Restarting) for event in observation.events)
    if attempts > 1:
        yield f"restarted {attempts} times, expected once"
    yield from _not_as_before(case, observation, is_lost=False)
    before, after = _pids(observation.before), _pids(observation.after)
    if after.get(case.unit.name) == before[case.unit.name]:
        yield f"{case.unit.name}: still the same process"


def _not_without(case: Case, observation: Observation) -> Iterator[str]:
    yield from _not_as_before(case, observation, is_lost=case.fault == "kill")
    if case.fault == "freeze":
        back = {m.event.node for m in observation.events if isinstance(m.event, AnswersAgain)}
        for node in case.unit.nodes:
            if node.has_lifecycle and node.full_name not in back:
                yield f"{node.full_name}: responds again, which was not reported"


def _not_as_before(case: Case, observation: Observation, *, is_lost: bool) -> Iterator[str]:
    """Changes in the stack, apart from the nodes into which the fault was injected."""
    if observation.exit_code is not None:
        yield "the stack shut down"
        return
    lost = tuple(f"{name}: " for name in case.unit.node_names) if is_lost else ()
    yield from (fault for fault in incompleteness(observation.after) if not fault.startswith(lost))
    before, after = _pids(observation.before), _pids(observation.after)
    for process, pid in before.items():
        if process != case.unit.name and after.get(process) not in (None, pid):
            yield f"{process}: was restarted without a fault of its own"


def _pids(status: StackStatus | None) -> dict[str, int | None]:
    return {node.process: node.pid for node in status.nodes} if status else {}
