"""A run for a program: one JSON object a line, the same records as in the run's `events.jsonl`.

The last line is the record of `Ended`; what comes after it is left to the log files.
"""

import json
from collections.abc import Callable, Iterable

from obk_cli.launch.events import Ended, OutputEvent
from obk_cli.launch.journal import event_record, output_record

__all__ = ["JsonReport"]


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
        """Lines that nobody read in time."""
        return json.dumps({"time": self._clock(), "event": "LeftOut", "lines": count})

    def _line(self, record: dict[str, object]) -> Iterable[str]:
        if not self._is_over:
            yield json.dumps(record)
