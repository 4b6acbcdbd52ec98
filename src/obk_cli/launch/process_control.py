"""Starts, signals and kills the processes of a run, and reports where a stuck one is. Pure."""

import signal
from collections.abc import Sequence
from typing import Final

from obk_cli.launch.event_loop import RunContext
from obk_cli.launch.events import Evidence

__all__ = ["ProcessControl"]

LAST_LINES: Final = 20
"""Of what a stuck node wrote before its stack dump, which may be longer than all of them."""


class ProcessControl:
    """The processes of this launch."""

    def __init__(self, context: RunContext) -> None:
        self._context = context
        self._killed: set[str] = set()
        """Units that were killed and whose end has not come yet."""

    def start(self, unit: str) -> None:
        """Start a process; nothing is known of its nodes any more."""
        context, state = self._context, self._context.state
        state.process_requested(unit)
        context.pending.forget(state.units[unit].node_names)
        context.processes.start(state.units[unit])

    def kill(self, unit: str) -> None:
        """End a process that nothing else helps with; its end is no crash."""
        if unit in self._context.state.running:
            self._killed.add(unit)
            self._context.processes.signal(unit, signal.SIGKILL)

    def was_killed(self, unit: str) -> bool:
        """Whether a process that has ended was killed here."""
        is_killed = unit in self._killed
        self._killed.discard(unit)
        return is_killed

    def end_all(self) -> None:
        """End what still runs: SIGINT, SIGTERM, SIGKILL."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self._signal_all(number)

    def report_evidence(self, node: str) -> None:
        """Publish what a stuck node's process wrote last, and where it is stuck."""
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
        context.publisher.publish(Evidence(node=node, lines=(*before[-LAST_LINES:], *dump)))

    def _signal_all(self, number: int) -> None:
        """Send a signal to what still runs, and wait for the ends."""
        context, state = self._context, self._context.state
        for unit in sorted(state.running):
            # Before it is ready a node does not handle SIGINT yet, but Python does: with a
            # traceback that is of no use.
            early = number == signal.SIGINT and state.is_early(unit)
            context.processes.signal(unit, signal.SIGTERM if early else number)
        begin = context.loop.now()
        while state.running:
            is_short = context.run.force_quit and number != signal.SIGKILL
            grace_s = context.limits.hurry_s if is_short else context.limits.grace_s
            if context.loop.wait(begin + grace_s) is None:
                return


def _newer_lines(before: Sequence[str], after: Sequence[str]) -> tuple[str, ...]:
    """The lines that a process wrote since.

    Args:
        before: the last lines then.
        after: the last lines now; the oldest ones of those before may have fallen out.
    """
    kept = next(n for n in range(len(before), -1, -1) if after[:n] == before[len(before) - n :])
    return tuple(after[kept:])
