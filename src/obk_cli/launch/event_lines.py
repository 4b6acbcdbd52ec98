"""Format the events of a run for the terminal, as JSON, and for the run's log files."""

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Final, assert_never

from obelisk_spec.suggestions import with_number
from obk_cli.clock import monotonic_s
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
    PageReported,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RateKept,
    RateMoved,
    RatesUnreported,
    Restarted,
    Restarting,
    SignalIgnored,
    StackStateChanged,
    StateSeen,
    TransitionEnded,
    VideoReported,
    WaitingFor,
)
from obk_cli.launch.rates import RateSummaries, RateSummary
from obk_cli.runs.lifecycle import ACTIVE, INACTIVE, UNCONFIGURED
from obk_cli.runs.logs import LAUNCH_LOG
from obk_cli.terminal import only_colour, plain

__all__ = ["STEADY", "Journal", "JsonReport", "LaunchReport", "event_record", "short_name"]


_NAMES: Final[Mapping[type[OutputEvent], str]] = {k: name for name, k in OUTPUT_EVENTS.items()}
_RED, _GREEN, _YELLOW, _BOLD, _DIM = "31", "32", "33", "1", "2"
_NODE_COLOURS = ("36", "35", "34", "33", "32", "96", "95", "94")
_MARKS = {
    "reached": ("ok", _GREEN),
    "already there": ("already in that state", _GREEN),
    "refused": ("FAILED", _RED),
    "timed out": ("TIMED OUT", _RED),
    "gone": ("GONE", _RED),
    "rolled back": ("rolled back", _YELLOW),
}
STEADY: Final = {
    "active": ACTIVE,
    "configured": INACTIVE,
    "started": UNCONFIGURED,
    "following": UNCONFIGURED,
}
"""Phases in which the stack changes only on request -> the stack's state when each one starts."""


def event_record(event: OutputEvent, time_s: float) -> dict[str, object]:
    """An event as in `events.jsonl` and in the stream of `--format json`.

    Args:
        event: what happened.
        time_s: when it happened [s since 1970].
    """
    return {"time": time_s, "event": _NAMES[type(event)], **asdict(event)}


def output_record(node: str, text: str, time_s: float) -> dict[str, object]:
    """A line of a node's output in the same format."""
    return {"time": time_s, "event": "Output", "node": node, "text": text}


class Journal:
    """The files of a run folder: `events.jsonl`, `launch.log`, and a log for each node.

    On the first file that cannot be written, it reports the fault and stops; the run continues.
    """

    def __init__(self, folder: Path | None, on_fault: Callable[[OSError], None]) -> None:
        """Write to a folder; None writes nothing. `on_fault` receives the first fault."""
        self._folder = folder
        self._on_fault = on_fault
        self._files: dict[str, IO[str]] = {}
        self._lock = threading.RLock()

    def event(self, event: OutputEvent, time_s: float) -> None:
        """Write an event, which happened at `time_s` [s since 1970]."""
        self._write("events.jsonl", json.dumps(event_record(event, time_s)))

    def shown(self, text: str) -> None:
        """Write a line for the user; of lines about rates, the screen shows only a summary."""
        self._write(LAUNCH_LOG, text)

    def line(self, node: str, text: str) -> None:
        """Write a line of a node's output, or of a process that nodes share."""
        self._write(f"{node.strip('/').replace('/', '.')}.log", text)

    def close(self) -> None:
        """Close the files; later calls write nothing."""
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
    """`/arm/obelisk_control_0` -> `arm/control_0`; also for a process that nodes share."""
    namespace, _, node = name.strip("/").rpartition("/")
    return f"{namespace}/{node.removeprefix('obelisk_')}".lstrip("/")


class LaunchReport:
    """Turns events and output into lines; may be called from several threads."""

    def __init__(
        self,
        nodes: Iterable[str],
        *,
        colour: bool,
        quiet: bool,
        clock: Callable[[], float] = monotonic_s,
    ) -> None:
        """Create a report.

        Args:
            nodes: full names, for colors and column width.
            colour: whether to use escape codes.
            quiet: hide the nodes' output.
            clock: monotonic time [s].
        """
        names = tuple(nodes)
        self._width = max((len(short_name(name)) for name in names), default=0)
        self._colours = dict(zip(names, _NODE_COLOURS * len(names), strict=False))
        self._colour = colour
        self._quiet = quiet
        self._clock = clock
        self._rates = RateSummaries()
        self._known_state: str | None = None
        """The stack's state last shown while steady; None: during bring-up or shutdown."""

    def line(self, node: str, text: str) -> Iterable[str]:
        """Format a line of a node's output, or of a process that nodes share."""
        if not self._quiet:
            colour = self._colours.get(node, _DIM)
            name = self._paint(colour, f"{short_name(node):<{self._width}} |")
            yield f"{name} {only_colour(text) if self._colour else plain(text)}"

    def note(self, text: str) -> Iterable[str]:
        """Format a message of the launcher."""
        yield plain(text)

    def on_screen(self, event: OutputEvent, lines: Iterable[str], /) -> Iterable[str]:
        """Choose which of an event's lines the screen shows now."""
        match event:
            case RateBroken() | RateKept() | RateMoved():
                return lines if self._rates.is_shown(event, self._clock()) else ()
            case Phase() | Ended():
                return (*map(self._rate_summary, self._rates.rest(self._clock())), *lines)
            case _:
                return lines

    def due(self) -> Iterable[str]:
        """The lines that sum up what was left out before; call it about once a second."""
        return map(self._rate_summary, self._rates.due(self._clock()))

    def event(self, event: OutputEvent) -> Iterable[str]:
        """Format an event."""
        match event:
            case Phase():
                if event.name != "rolling back":  # the phase does not change
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
            case ProcessStarted() | ProcessEnded() | SignalIgnored():
                yield self._process(event)
            case GoesOnWithout() | Restarting() | Restarted():
                yield self._after_a_crash(event)
            case RateBroken() | RateKept() | RateMoved():
                yield from self._rate(event)
            case RatesUnreported():
                yield self._paint(_YELLOW, f"  {short_name(event.node)}: {plain(event.how)}")
            case ActivationReported() | VideoReported():
                return  # useful to lockstep runs only; shown at the end of the run
            case PageReported():
                yield from self._page(event)
            case _:
                yield from self._node(event)

    def _page(self, event: PageReported) -> Iterator[str]:
        """Report where a simulation is shown, but not when the page goes away."""
        if event.url:
            yield f"  {short_name(event.node)}: the simulation is shown at {plain(event.url)}"

    def _process(self, event: ProcessStarted | ProcessEnded | SignalIgnored) -> str:
        match event:
            case ProcessStarted():
                return f"  {short_name(event.process)}: process {event.pid}"
            case ProcessEnded():
                return self._paint(_RED, f"  {short_name(event.process)}: {plain(event.how)}")
            case SignalIgnored():
                late = f"still running {event.seconds:.1f} s after {event.signal}"
                return self._paint(_YELLOW, f"  {_names(event.processes)}: {late}")

    def _node(
        self, event: TransitionEnded | StateSeen | Failed | Hung | AnswersAgain | Evidence
    ) -> Iterator[str]:
        name = short_name(event.node)
        match event:
            case TransitionEnded():
                mark, colour = _MARKS[event.result]
                took = f" ({event.seconds * 1e3:.0f} ms)" if event.result != "already there" else ""
                yield f"  {name}: {event.transition} {self._paint(colour, mark)}{took}"
                yield from self._fault(event.fault)
            case StateSeen():
                why = "not requested by this launch" if event.transition else "after its failure"
                yield f"  {name}: {event.state} ({why})"
            case Failed():
                yield self._paint(_RED, f"  {name}: FAILED")
                yield from self._fault(event.fault)
            case Hung():
                yield self._paint(_RED, f"  {name}: HUNG: no answer for {event.seconds:.1f} s")
            case AnswersAgain():
                yield self._paint(_GREEN, f"  {name}: answering again")
            case Evidence():
                # Without --quiet, the node's output has already shown these lines.
                if self._quiet and event.lines:
                    yield f"  {name}: its last output:"
                    yield from (f"    {plain(line)}" for line in event.lines)
            case _:
                assert_never(event)

    def _rate(self, event: RateBroken | RateKept | RateMoved) -> Iterator[str]:
        """Report a rate when it breaks and when it recovers; not while it moves."""
        name = short_name(event.node)
        match event:
            case RateBroken():
                yield self._paint(_RED, f"  {name}: RATE: {plain(event.how)}")
            case RateKept():
                yield self._paint(_GREEN, f"  {name}: {plain(str(event.rate))} again")

    def _rate_summary(self, summary: RateSummary) -> str:
        name, text = short_name(summary.node), plain(summary.text)
        if summary.now == "kept":
            return self._paint(_GREEN, f"  {name}: {text}")
        colour = _RED if summary.now == "broken" else _YELLOW
        return self._paint(colour, f"  {name}: RATE: {text}")

    def _after_a_crash(self, event: GoesOnWithout | Restarting | Restarted) -> str:
        names = _names(event.nodes)
        match event:
            case Restarting():
                count = f"restart {event.attempt} of {event.attempts}"
                return self._paint(_YELLOW, f"  {names}: {count} in {event.wait_s:.1f} s")
            case Restarted():
                return self._paint(_GREEN, f"  {names}: recovered")
            case GoesOnWithout():
                return self._paint(_YELLOW, f"  the stack continues without {names}")

    def _stack_state(self, state: str) -> Iterator[str]:
        """Report only requested changes of a steady stack; phases report everything else."""
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
            yield f"  followed by {with_number(event.consequences, 'more failure')}"

    def _fault(self, fault: str) -> Iterable[str]:
        """The node's own message; with its traceback only if the node's output is hidden."""
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
        """Create a report.

        Args:
            clock: returns the time [s since 1970].
            quiet: hide the nodes' output.
        """
        self._clock = clock
        self._quiet = quiet

    def event(self, event: OutputEvent) -> Iterable[str]:
        """Format an event."""
        yield json.dumps(event_record(event, self._clock()))

    def on_screen(self, _event: OutputEvent, lines: Iterable[str], /) -> Iterable[str]:
        """Show every event."""
        return lines

    def due(self) -> Iterable[str]:
        """Nothing: no event was left out."""
        return ()

    def line(self, node: str, text: str) -> Iterable[str]:
        """Format a line of a node's output."""
        if not self._quiet:
            yield json.dumps(output_record(node, text, self._clock()))

    def note(self, text: str) -> Iterable[str]:
        """Format a message of the launcher."""
        yield json.dumps({"time": self._clock(), "event": "Note", "text": text})

    def left_out(self, count: int) -> str:
        """Report lines that were dropped because the reader was too slow."""
        return json.dumps({"time": self._clock(), "event": "LeftOut", "lines": count})
