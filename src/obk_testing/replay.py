"""Run nodes of a config in lockstep on recorded inputs: `python -m obk_testing.replay REQUEST`.

`obk play --into` starts it. REQUEST is a `ReplayRequest` as JSON. Messages published by the nodes
are written to a new recording. If the input was recorded in lockstep, every message arrives at
the recorded time and in the recorded order, so the same code yields bitwise equal outputs. Other
recordings are replayed on the clock of their nodes. Wall time is shifted, together with the stamps
of the messages, because lockstep begins at time 0.
"""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
from rclpy.logging import LoggingSeverity, set_logger_level

from obelisk_py.core.lockstep.interception import intercepted
from obelisk_py.core.lockstep.scheduler import NS_PER_S, LockstepError
from obelisk_recordings.bag import RecordingError
from obelisk_recordings.chunks import RecordedMessage, messages_in_order
from obelisk_recordings.clock import RecordedClock, with_earlier_stamps
from obelisk_recordings.layout import HEADER, MessageDefinition, parse_definition
from obelisk_recordings.run import RecordedRun, open_run
from obk_cli.errors import EXIT_DONE, EXIT_FAILED, CommandFailedError
from obk_cli.record.recorder import installed_definition, schema_text
from obk_testing.programs import load_stack
from obk_testing.recording import write_recording
from obk_testing.schedule import Schedule
from obk_testing.trial import StackTrial

__all__ = ["ReplayRequest", "main", "replay"]

_SLICE_NS: Final = NS_PER_S
"""Time range of messages that are scheduled at once [ns]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRequest:
    """A request to run nodes on recorded inputs."""

    config: str
    overrides: tuple[str, ...]
    without: tuple[str, ...]
    """Full names of the nodes to leave out."""
    recording: str
    inputs: tuple[str, ...]
    """Topics taken from the recording."""
    outputs: tuple[str, ...]
    """Topics that the nodes publish."""
    output: str
    """Path of the new recording."""


def replay(request: ReplayRequest) -> Iterator[str]:
    """Run the nodes, write the messages that they publish, and yield notes for the user.

    Raises:
        CommandFailedError: the config cannot be run, message definitions differ, or a node failed.
        LockstepError: a node cannot run in lockstep.
        RecordingError: the recording cannot be read.
    """
    run = open_run(request.recording)
    times = _times(run, request.inputs)
    stack = load_stack(Path(request.config), request.overrides, without=request.without)
    try:
        names = {node.planned.full_name for node in stack.nodes}
        schedule, notes = _schedule(run, names)
        yield from notes
        if times.start_ns:
            late = [node.planned.full_name for node in stack.nodes if not node.planned.model]
            start_s = times.start_ns / NS_PER_S
            schedule = replace(schedule, bring_up=dict.fromkeys(late, start_s))
        seed = int(run.metadata.get("obelisk", {}).get("seed", "0")) if run.is_lockstep else 0
        with StackTrial(stack, seed=seed, schedule=schedule, watch=request.outputs) as trial:
            _require_types(run, request.inputs, trial)
            yield from _feed(trial, run, request, times)
            result = trial.result()
            about = {"replay": run.name, "shift_ns": str(times.shift_ns)}
            write_recording(Path(request.output), result, about)
            if result.faults:
                raise CommandFailedError(
                    "\n".join(result.faults),
                    help=f"{request.output} contains the messages published until then",
                )
    finally:
        stack.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Times:
    """Converts times of the recorded run to those of the replay."""

    clock: RecordedClock
    shift_ns: int
    """Subtracted from recorded times and stamps; 0 unless they are wall times."""
    start_ns: int
    """When the nodes become active in the replay: at the first input; in lockstep, 0 [ns]."""

    def time_ns(self, published_ns: int) -> int:
        return max(self.clock.time_ns(published_ns) - self.shift_ns, 0)


def _times(run: RecordedRun, inputs: tuple[str, ...]) -> _Times:
    clock = RecordedClock(run)
    first = next(messages_in_order(run.path, inputs), None)
    if run.is_lockstep or first is None:
        return _Times(clock=clock, shift_ns=0, start_ns=0)
    first_ns = clock.time_ns(first.published_ns)
    # Messages were stamped before they were published.
    shift_ns = 0 if clock.is_simulated else first_ns - NS_PER_S
    return _Times(clock=clock, shift_ns=shift_ns, start_ns=first_ns - shift_ns)


def _schedule(run: RecordedRun, names: set[str]) -> tuple[Schedule, list[str]]:
    """Return the recorded run's schedule for some nodes, and notes on what cannot be repeated."""
    values = _attached(run, "schedule.json")
    if not isinstance(values, dict):
        return Schedule(), []
    notes = []
    if values.get("phases"):
        notes.append("the timers of the recorded run had random phases, which are not repeated")
    if _attached(run, "interventions.json"):
        notes.append("the test's interventions in the recorded run are not repeated")
    compute, bring_up = (
        {name: float(one) for name, one in values.get(key, {}).items() if name in names}
        for key in ("compute", "bring_up")
    )
    schedule = Schedule(
        latency=float(values.get("latency", 0.0)),
        jitter=float(values.get("jitter", 0.0)),
        compute=compute,
        bring_up=bring_up,
    )
    return schedule, notes


def _attached(run: RecordedRun, name: str) -> Any:
    try:
        return json.loads(run.attachments.get(name, "null"))
    except ValueError:
        return None


def _require_types(run: RecordedRun, inputs: tuple[str, ...], trial: StackTrial) -> None:
    recorded = {one.topic: one.msg_type for one in run.bag.topics}
    definitions = run.definitions(inputs)
    for topic in inputs:
        kind = trial.message_type(topic)
        if recorded[topic] != kind:
            raise CommandFailedError(
                f"{topic} was recorded as {recorded[topic]}, but the node subscribes to {kind}"
            )
        here = schema_text(kind, installed_definition)
        theirs = definitions.get(topic)
        if here is None or theirs is None:
            continue
        if _fields(parse_definition(kind, here)) != _fields(theirs):
            raise CommandFailedError(f"{topic}: the definition of {kind} differs in the recording")


def _fields(definition: MessageDefinition) -> Mapping[str, list[tuple[Any, ...]]]:
    """Return everything in a definition that determines the bytes of a message."""
    return {
        kind: [(one.name, one.kind, one.size, one.is_sequence) for one in fields]
        for kind, fields in definition.types.items()
    }


def _feed(
    trial: StackTrial, run: RecordedRun, request: ReplayRequest, times: _Times
) -> Iterator[str]:
    """Run until the end of the recording, with the inputs at their times.

    Yields:
        Notes on topics whose stamps stay as recorded.
    """
    ticks = _ticks(run, request.outputs) if run.is_lockstep else {}
    definitions = run.definitions(request.inputs) if times.shift_ns else {}
    stamped = {topic: one for topic, one in definitions.items() if HEADER in one.types}
    fed_ns = 0
    for message in messages_in_order(run.path, request.inputs):
        time_ns = times.time_ns(message.published_ns)
        if time_ns - fed_ns > _SLICE_NS:
            trial.run((time_ns - fed_ns - 1) / NS_PER_S)
            fed_ns = round(trial.t * NS_PER_S)
        data, definition = message.data, stamped.get(message.topic)
        if definition is not None:
            try:
                data = with_earlier_stamps(data, definition, times.shift_ns)
            except RecordingError as error:
                yield f"the stamps on {message.topic} stay as recorded: {error}"
                del stamped[message.topic]
        trial.feed(message.topic, data, time_ns, after_timers=_is_late(message, ticks))
    end_ns = times.time_ns(run.bag.end_ns or 0)
    trial.run(max(0, end_ns - round(trial.t * NS_PER_S)) / NS_PER_S)


def _ticks(run: RecordedRun, outputs: tuple[str, ...]) -> dict[int, int]:
    """Map times of the nodes' messages in the recorded run [ns] to the last sequence number."""
    found: dict[int, int] = {}
    for one in messages_in_order(run.path, outputs):
        found[one.published_ns] = max(one.sequence, found.get(one.published_ns, 0))
    return found


def _is_late(message: RecordedMessage, ticks: Mapping[int, int]) -> bool:
    """Whether the nodes had published before the message, at the same time."""
    return ticks.get(message.published_ns, message.sequence) < message.sequence


def main(arguments: list[str]) -> int:
    """Run a request, and return the exit code."""
    request = msgspec.json.decode(arguments[0], type=ReplayRequest)
    # Nodes of several programs have the same loggers, and lockstep does not use rcl's /rosout.
    set_logger_level("rcl.logging_rosout", LoggingSeverity.ERROR)
    with intercepted():
        try:
            for note in replay(request):
                print(f"note: {note}", file=sys.stderr)
        except (CommandFailedError, LockstepError, RecordingError) as error:
            print(f"error: {error}", file=sys.stderr)
            if isinstance(error, CommandFailedError) and error.help:
                print(f"  help: {error.help}", file=sys.stderr)
            return EXIT_FAILED
    return EXIT_DONE


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # programs are waiting in their own threads
