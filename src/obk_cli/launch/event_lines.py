"""The events of a run as lines of a terminal, as JSON, and as the log files of the run."""

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Final, assert_never

from obelisk_spec.suggestions import with_number
from obk_cli.launch.events import (
    OUTPUT_EVENTS,
    ActivationReported,
    AnswersAgain,
    Ended,
    Evidence,
    Failed,
    GoesOnWithout,
    Hung,
    OutputEvent,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RateKept,
    RateMoved,
    RatesUnreported,
    Restarted,
    Restarting,
    StackStateChanged,
    StateSeen,
    TransitionEnded,
    VideoReported,
    WaitingFor,
)
from obk_cli.runs.lifecycle import ACTIVE, INACTIVE, UNCONFIGURED
from obk_cli.terminal import only_colour, plain

__all__ = [
    "STEADY",
    "Journal",
    "JsonReport",
    "LaunchReport",
    "event_record",
    "output_record",
    "short_name",
]


_NAMES: Final[Mapping[type[OutputEvent], str]] = {k: name for name, k in OUTPUT_EVENTS.items()}
_RED, _GREEN, _YELLOW, _BOLD, _DIM = "31", "32", "33", "1", "2"
_NODE_COLOURS = ("36", "35", "34", "33", "32", "96", "95", "94")
_MARKS = {
    "reached": ("ok", _GREEN),
    "there already": ("there already", _GREEN),
    "refused": ("FAILED", _RED),
    "timed out": ("TIMED OUT", _RED),
    "gone": ("GONE", _RED),
    "taken back": ("taken back", _YELLOW),
}
STEADY: Final = {
    "active": ACTIVE,
    "configured": INACTIVE,
    "started": UNCONFIGURED,
    "following": UNCONFIGURED,
}
"""Phases in which the stack changes only on request, and the state in which each one starts."""


def event_record(event: OutputEvent, time_s: float) -> dict[str, object]:
    """An event as in `events.jsonl` and in the stream of `--format json`.

    Args:
        event: what happened.
        time_s: when [s since 1970].
    """
    return {"time": time_s, "event": _NAMES[type(event)], **asdict(event)}


def output_record(node: str, text: str, time_s: float) -> dict[str, object]:
    """A line of a node's output in the same form."""
    return {"time": time_s, "event": "Output", "node": node, "text": text}


class Journal:
    """The files of a run folder: `events.jsonl`, `launch.log`, and a log for each node.

    The first file that cannot be written is reported, and ends all writing; the run goes on.
    """

    def __init__(self, folder: Path | None, on_fault: Callable[[OSError], None]) -> None:
        """Write below a folder; None writes nothing. `on_fault` takes the first fault."""
        self._folder = folder
        self._on_fault = on_fault
        self._files: dict[str, IO[str]] = {}
        self._lock = threading.RLock()

    def event(self, event: OutputEvent, time_s: float) -> None:
        """Note an event and when it happened [s since 1970]."""
        self._write("events.jsonl", json.dumps(event_record(event, time_s)))

    def shown(self, text: str) -> None:
        """Note a line that the user sees."""
        self._write("launch.log", text)

    def line(self, node: str, text: str) -> None:
        """Note a line of a node's output, or of a process that nodes share."""
        self._write(f"{node.strip('/').replace('/', '.')}.log", text)

    def close(self) -> None:
        """Close the files; nothing is written after that."""
        with self._lock:
            self._folder = None
            for file in self._files.values():
                with suppress(OSError):
                    file.close()
            self._files.clear()

    def _write(self, name: str, text: str) -> None:
        with self._lock:
            if self._folder is None:
                return
            try:
                self._file(self._folder / name).write(text + "\n")
            except OSError as error:
                self.close()
                self._on_fault(error)

    def _file(self, path: Path) -> IO[str]:
        if path.name not in self._files:
            self._files[path.name] = path.open("a", buffering=1, encoding="utf-8", errors="replace")
        return self._files[path.name]


def short_name(name: str) -> str:
    """`/arm/obelisk_control_0` -> `arm/control_0`; also of a process that nodes share."""
    namespace, _, node = name.strip("/").rpartition("/")
    return f"{namespace}/{node.removeprefix('obelisk_')}".lstrip("/")


class LaunchReport:
    """Turns events and output into lines; may be called from several threads."""

    def __init__(self, nodes: Iterable[str], *, colour: bool, quiet: bool) -> None:
        """Make a report.

        Args:
            nodes: full names, for colours and column width.
            colour: whether to use escape codes.
            quiet: leave the nodes' output out.
        """
        names = tuple(nodes)
        self._width = max((len(short_name(name)) for name in names), default=0)
        self._colours = dict(zip(names, _NODE_COLOURS * len(names), strict=False))
        self._colour = colour
        self._quiet = quiet
        self._known_state: str | None = None
        """The stack's state as shown last, while it is steady; None: on its way up or down."""

    def line(self, node: str, text: str) -> Iterable[str]:
        """A line of a node's output, or of a process that nodes share."""
        if not self._quiet:
            colour = self._colours.get(node, _DIM)
            name = self._paint(colour, f"{short_name(node):<{self._width}} |")
            yield f"{name} {only_colour(text) if self._colour else plain(text)}"

    def note(self, text: str) -> Iterable[str]:
        """A sentence of the launcher's own."""
        yield plain(text)

    def event(self, event: OutputEvent) -> Iterable[str]:
        """What happened."""
        match event:
            case Phase():
                if event.name != "rolling back":  # after which the stack is where it was
                    self._known_state = STEADY.get(event.name)
                detail = f" ({plain(event.detail)})" if event.detail else ""
                yield self._paint(_BOLD, f"[{event.seconds:6.2f} s] {event.name}{detail}")
            case StackStateChanged():
                yield from self._stack_state(event.state)
            case WaitingFor():
                where = ", ".join(event.devices)
                yield f"  waiting for nodes of {where}: {_names(event.nodes)}"
            case Ended():
                yield from self._ended(event)
            case ProcessStarted() | ProcessEnded():
                yield from self._process(event)
            case GoesOnWithout() | Restarting() | Restarted():
                yield self._after_a_crash(event)
            case RateBroken() | RateKept() | RateMoved():
                yield from self._rate(event)
            case RatesUnreported():
                yield self._paint(_YELLOW, f"  {short_name(event.node)}: {plain(event.how)}")
            case ActivationReported():
                return  # of use to lock-step runs only
            case VideoReported():
                return  # shown at the end of the run
            case _:
                yield from self._node(event)

    def _process(self, event: ProcessStarted | ProcessEnded) -> Iterator[str]:
        name = short_name(event.process)
        match event:
            case ProcessStarted():
                yield f"  {name}: process {event.pid}"
            case ProcessEnded():
                yield self._paint(_RED, f"  {name}: {plain(event.how)}")

    def _node(
        self, event: TransitionEnded | StateSeen | Failed | Hung | AnswersAgain | Evidence
    ) -> Iterator[str]:
        name = short_name(event.node)
        match event:
            case TransitionEnded():
                mark, colour = _MARKS[event.result]
                took = f" ({event.seconds * 1e3:.0f} ms)" if event.result != "there already" else ""
                yield f"  {name}: {event.transition} {self._paint(colour, mark)}{took}"
                yield from self._fault(event.fault)
            case StateSeen():
                why = "requested elsewhere" if event.transition else "after its failure"
                yield f"  {name}: {event.state} ({why})"
            case Failed():
                yield self._paint(_RED, f"  {name}: FAILED")
                yield from self._fault(event.fault)
            case Hung():
                yield self._paint(_RED, f"  {name}: HUNG: no answer for {event.seconds:.1f} s")
            case AnswersAgain():
                yield self._paint(_GREEN, f"  {name}: answers again")
            case Evidence():
                # The node's output, which is shown too, has the same lines.
                if self._quiet and event.lines:
                    yield f"  {name}: its last output:"
                    yield from (f"    {plain(line)}" for line in event.lines)
            case _:
                assert_never(event)

    def _rate(self, event: RateBroken | RateKept | RateMoved) -> Iterator[str]:
        """Only when it breaks and when it is kept again."""
        name = short_name(event.node)
        match event:
            case RateBroken():
                yield self._paint(_RED, f"  {name}: RATE: {plain(event.how)}")
            case RateKept():
                yield self._paint(_GREEN, f"  {name}: {plain(str(event.rate))} again")

    def _after_a_crash(self, event: GoesOnWithout | Restarting | Restarted) -> str:
        names = _names(event.nodes)
        match event:
            case Restarting():
                count = f"restart {event.attempt} of {event.attempts}"
                return self._paint(_YELLOW, f"  {names}: {count} in {event.wait_s:.1f} s")
            case Restarted():
                return self._paint(_GREEN, f"  {names}: back again")
            case GoesOnWithout():
                return self._paint(_YELLOW, f"  the stack goes on without {names}")

    def _stack_state(self, state: str) -> Iterator[str]:
        """Only requested changes of a steady stack; phases report everything else."""
        if self._known_state not in (None, state):
            self._known_state = state
            yield f"  the stack: {state}"

    def _ended(self, event: Ended) -> Iterator[str]:
        if not event.cause:
            yield self._paint(_GREEN, "stopped cleanly")
            return
        yield self._paint(_RED, f"failed: {plain(event.cause)}")
        if event.origin:
            yield f"  defined at {plain(event.origin)}"
        if event.consequences:
            yield f"  {with_number(event.consequences, 'more failure')} after it"

    def _fault(self, fault: str) -> Iterable[str]:
        """A node's own message; the traceback only if the node's output does not show it."""
        lines = fault.splitlines()
        shown = lines if self._quiet else _without_traceback(lines)
        return (f"    {plain(line)}" for line in shown)

    def _paint(self, code: str, text: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if self._colour else text


def _names(nodes: Iterable[str]) -> str:
    return ", ".join(map(short_name, nodes))


def _without_traceback(lines: list[str]) -> list[str]:
    start = next((n for n, line in enumerate(lines) if line.startswith("Traceback ")), None)
    return lines[:start]


class JsonReport:
    """Turns events and output into lines; may be called from several threads."""

    def __init__(self, clock: Callable[[], float], *, quiet: bool) -> None:
        """Make a report.

        Args:
            clock: the time of day [s since 1970].
            quiet: leave the nodes' output out.
        """
        self._clock = clock
        self._quiet = quiet
        self._is_over = False

    def event(self, event: OutputEvent) -> Iterable[str]:
        """What happened."""
        yield from self._line(event_record(event, self._clock()))
        self._is_over = self._is_over or isinstance(event, Ended)

    def line(self, node: str, text: str) -> Iterable[str]:
        """A line of a node's output."""
        if not self._quiet:
            yield from self._line(output_record(node, text, self._clock()))

    def note(self, text: str) -> Iterable[str]:
        """A sentence of the launcher's own."""
        yield from self._line({"time": self._clock(), "event": "Note", "text": text})

    def left_out(self, count: int) -> str:
        """Report lines that were dropped because the reader was too slow."""
        return json.dumps({"time": self._clock(), "event": "LeftOut", "lines": count})

    def _line(self, record: dict[str, object]) -> Iterable[str]:
        if not self._is_over:
            yield json.dumps(record)
