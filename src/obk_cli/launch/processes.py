"""Start and signal node processes through the warden, and read their output line by line."""

import json
import os
import re
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from obk_cli.launch.event_loop import RunContext
from obk_cli.launch.events import Evidence, OutputLine, ProcessEnded, ProcessStarted, SignalIgnored
from obk_cli.launch.process_groups import Unit
from obk_cli.launch.warden_client import WardenClient

__all__ = ["LOG_PREFIX", "NodeCommand", "ProcessControl", "ProcessEvent", "WardenProcesses"]

LAST_WORDS_S = 1.0
"""Limit for reading the rest of an ended process's output [s]."""
END_S = 2.0
"""Limit for each step of the final cleanup [s]."""
KEPT_LINES = 60
"""Number of output lines kept per process, to show the last ones."""
LONGEST_REASON = 300
"""The last line of a process is cut after this number of characters when it is the reason of an
exit."""
LONGEST_LINE = 1 << 16
"""Output without line ends is cut into pieces of this size [characters]."""
STACK_SIGNAL = signal.SIGUSR1
"""On this signal, processes of the runtime library write their stacks."""
NO_WARDEN = "the process that watches over the nodes has exited"
LOG_PREFIX = re.compile(r"\[(?:DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] \[([^\]]*)\]: ")
"""What ROS writes before a logged line; the group is the logger's name."""


ProcessEvent = ProcessStarted | ProcessEnded


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeCommand:
    """How a node's process is started."""

    arguments: tuple[str, ...]
    environment: Mapping[str, str]
    in_python: tuple[str, ...] = ()
    """The same program, run by this Python: `python -P -m ...`; empty if it cannot run the
    program."""
    inherited: tuple[int, ...] = ()
    """Descriptors of the launcher that the process inherits, under the same numbers."""


class WardenProcesses:
    """Node processes that die with this one, however it ends."""

    def __init__(
        self,
        *,
        commands: Mapping[str, NodeCommand],
        folder: Path,
        warden: WardenClient,
        on_event: Callable[[ProcessEvent], None],
        on_line: Callable[[OutputLine], None],
    ) -> None:
        """Use a warden with its preload server, if it has one.

        Args:
            commands: by the name of the unit.
            folder: the processes' working folder.
            warden: the parent of the processes; `end` also ends it.
            on_event: receives starts and ends, from a thread.
            on_line: receives output lines, from one thread per process.
        """
        self._commands = commands
        self._folder = folder
        self._on_event = on_event
        self._on_line = on_line
        self._pumps: dict[str, threading.Thread] = {}
        self._last_lines: dict[str, deque[str]] = {}
        self._running: dict[str, int] = {}
        """Unit -> process id."""
        self._requested: set[str] = set()
        """Units whose start was requested and whose exit is not yet reported."""
        self._held_back: dict[str, list[ProcessEvent]] = {}
        """Unit that was started early -> its events, held until `start` is called for it."""
        self._reporting = threading.Lock()
        self._warden = warden
        self._preload = warden.preload
        shared = {fd for command in commands.values() for fd in command.inherited}
        warden.share(sorted(shared))
        warden.adopt_orphans()
        self._listener = threading.Thread(target=self._listen, name="warden", daemon=True)
        self._listener.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()

    def end(self) -> None:
        """Stop the running processes and the warden; only the first call has an effect."""
        self._warden.end()
        self._listener.join(END_S)
        deadline = time.monotonic() + END_S
        for pump in self._pumps.values():
            pump.join(max(0.0, deadline - time.monotonic()))

    def start(self, unit: Unit) -> None:
        """Start a process; `ProcessStarted` or `ProcessEnded` follows."""
        with self._reporting:
            held_back = self._held_back.pop(unit.name, None)
            for event in held_back or ():
                self._on_event(event)
        if held_back is None:
            self._start(unit)

    def start_early(self, unit: Unit) -> None:
        """Start a process whose events are held until `start`."""
        self._held_back[unit.name] = []
        self._start(unit)

    def _start(self, unit: Unit) -> None:
        command = self._commands[unit.name]
        read_fd, write_fd = os.pipe2(os.O_CLOEXEC)
        request = {
            "do": "start",
            "node": unit.name,
            "arguments": command.arguments,
            "environment": dict(command.environment),
            "folder": str(self._folder),
            "inherited": command.inherited,
            "preloaded": self._preload.forked(command.in_python, command.environment)
            if self._preload is not None
            else None,
        }
        self._requested.add(unit.name)
        is_sent = self._warden.send(request, write_fd)
        os.close(write_fd)
        if not is_sent:
            self._report_lost(unit.name)
        # Not those of the previous process, whose children may still write.
        lines = self._last_lines[unit.name] = deque(maxlen=KEPT_LINES)
        pump = threading.Thread(
            target=self._pump, args=(unit.name, read_fd, lines), name="output", daemon=True
        )
        pump.start()
        self._pumps[unit.name] = pump

    def signal(self, process: str, number: int) -> None:
        """Send a signal to a process and its children in the same group."""
        # Without a warden no nodes are running: `_listen` has reported their exits.
        self._warden.send({"do": "signal", "node": process, "number": number})

    def dump_stack(self, process: str) -> None:
        """Make a process write the stacks of its threads, if it handles the signal for that."""
        pid = self._running.get(process)
        if pid is not None and _catches(pid, STACK_SIGNAL):
            with suppress(ProcessLookupError):
                os.kill(pid, STACK_SIGNAL)

    def last_lines(self, process: str) -> tuple[str, ...]:
        """The last lines of a process's output."""
        return tuple(self._last_lines.get(process, ()))

    def wait_for_output(self, processes: Iterable[str]) -> None:
        """Wait until the output of processes that have ended was read.

        Not for long, because children that they leave behind may write to it as well.
        """
        deadline = time.monotonic() + LAST_WORDS_S
        for process in processes:
            if process in self._pumps:
                self._pumps[process].join(max(0.0, deadline - time.monotonic()))

    def _listen(self) -> None:
        while data := self._warden.receive():
            event = json.loads(data)
            node = event["node"]
            if event["event"] == "started":
                self._running[node] = event["pid"]
                self._report(ProcessStarted(process=node, pid=event["pid"]))
            else:
                self._running.pop(node, None)
                self._requested.discard(node)
                text = event["text"] or (self._last_words(node) if event["code"] > 0 else "")
                self._report(ProcessEnded(process=node, code=event["code"], text=text))
        # The nodes die with the warden, and nothing else would report that.
        for node in sorted(self._requested):
            self._report_lost(node)

    def _report_lost(self, process: str) -> None:
        """Report, once, that a process ended with the warden or could not be started by it."""
        try:
            self._requested.remove(process)
        except KeyError:  # already reported by the other thread
            return
        code = -signal.SIGKILL if process in self._running else 127
        self._report(ProcessEnded(process=process, code=code, text=NO_WARDEN))

    def _report(self, event: ProcessEvent) -> None:
        with self._reporting:
            held_back = self._held_back.get(event.process)
            if held_back is not None:
                held_back.append(event)
                return
        self._on_event(event)

    def _last_words(self, node: str) -> str:
        """The last line of a process's output: for a crashed Python program, its exception."""
        pump = self._pumps.get(node)
        if pump is not None:
            pump.join(LAST_WORDS_S)
        # A copy, because children of the process may still write.
        lines = [line for line in self.last_lines(node) if line.strip()]
        last = LOG_PREFIX.sub("", lines[-1].strip(), count=1) if lines else ""
        return last if len(last) <= LONGEST_REASON else f"{last[:LONGEST_REASON]}..."

    def _pump(self, node: str, read_fd: int, lines: deque[str]) -> None:
        with open(read_fd, encoding="utf-8", errors="replace") as output:
            while line := output.readline(LONGEST_LINE):
                text = line.rstrip("\n")
                lines.append(text)
                self._on_line(OutputLine(process=node, text=text))


def _catches(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal; without one, the signal would kill it.

    Source: proc_pid_status(5), SigCgt.
    """
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    caught = next((line for line in status.splitlines() if line.startswith("SigCgt:")), "SigCgt: 0")
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


LAST_LINES: Final = 20
"""Number of output lines shown before a stuck node's stack dump, which may itself be longer."""


class ProcessControl:
    """The processes of this launch."""

    def __init__(self, context: RunContext) -> None:
        self._context = context
        self._killed: set[str] = set()
        """Units that were killed and whose exit is not yet reported."""

    def start(self, unit: str) -> None:
        """Start a process, and forget everything known about its nodes."""
        context, state = self._context, self._context.state
        state.process_requested(unit)
        context.pending.forget(state.units[unit].node_names)
        context.processes.start(state.units[unit])

    def kill(self, unit: str) -> None:
        """Kill a process as a last resort; its exit does not count as a crash."""
        if unit in self._context.state.running:
            self._killed.add(unit)
            self._context.processes.signal(unit, signal.SIGKILL)

    def was_killed(self, unit: str) -> bool:
        """Whether a process that has ended was killed by `kill`."""
        is_killed = unit in self._killed
        self._killed.discard(unit)
        return is_killed

    def end_all(self) -> None:
        """Terminate all running processes: SIGINT, SIGTERM, SIGKILL."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self._signal_all(number)
        # So that nothing follows the last line of the launch.
        self._context.processes.wait_for_output(self._context.state.units)

    def report_evidence(self, node: str) -> None:
        """Publish the last output of a stuck node's process, and its stack dump."""
        context = self._context
        unit = context.state.unit_of.get(node)
        if unit is None or context.run.force_quit:
            return
        before = context.processes.last_lines(unit)
        context.processes.dump_stack(unit)
        until = context.loop.now() + context.limits.dump_s
        while context.loop.wait(until):
            pass
        dump = _newer_lines(before, context.processes.last_lines(unit))
        context.publisher.publish(Evidence(node=unit, lines=(*before[-LAST_LINES:], *dump)))

    def _signal_all(self, number: int) -> None:
        """Send a signal to all running processes, and wait until they exit."""
        context, state = self._context, self._context.state
        sent: dict[str, int] = {}
        for unit in sorted(state.running):
            # Before it is ready, a node does not handle SIGINT yet, but Python does, with a
            # useless traceback.
            early = number == signal.SIGINT and state.is_early(unit)
            sent[unit] = signal.SIGTERM if early else number
            context.processes.signal(unit, sent[unit])
        start = context.loop.now()
        while state.running:
            is_short = context.run.force_quit and number != signal.SIGKILL
            grace_s = context.limits.hurry_s if is_short else context.limits.grace_s
            if context.loop.wait(start + grace_s) is None:
                for each in sorted(set(sent.values())):
                    late = tuple(u for u in sent if u in state.running and sent[u] == each)
                    name = signal.Signals(each).name
                    if late:
                        event = SignalIgnored(processes=late, signal=name, seconds=grace_s)
                        context.publisher.publish(event)
                return


def _newer_lines(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """The lines that a process wrote since then.

    Args:
        before: the last lines at that time.
        after: the last lines now; the oldest of `before` may have been dropped.
    """
    kept = next(n for n in range(len(before), -1, -1) if after[:n] == before[len(before) - n :])
    return tuple(after[kept:])
