"""The fields that pages draw, heard in the thread that watches the stack.

Pages say what they want from threads of their own; what came is kept for a while after the last
page has gone, so that one that is loaded anew goes on where it was.
"""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from obk_cli.clock import monotonic_s
from obk_cli.errors import ObkError
from obk_cli.introspect.field_path import (
    ArrayType,
    Selection,
    Text,
    check_selection,
    parse_selection,
    selected,
)
from obk_cli.ros.participant import RosLook
from obk_cli.ros.raw_subscription import RawTopic, arrived
from obk_cli.ros.types import fields_of, find_type, short_type
from obk_cli.web.traces import Heard, Trace, Wish, numbers_in

__all__ = ["Plots"]

KEPT_S: Final = 5.0
"""For which nobody has to want a field before it is forgotten [s]."""


class _Plot:
    """A field that is wanted."""

    def __init__(self) -> None:
        self.trace = Trace()
        self.pages = 0
        self.left_s = 0.0
        self.raw: RawTopic | None = None
        self.selection: Selection | None = None


class Plots:
    """The fields that are wanted now."""

    def __init__(self) -> None:
        """Begin with none."""
        self._lock = threading.Lock()
        self._plots: dict[Wish, _Plot] = {}
        self._look: RosLook | None = None

    @contextmanager
    def wanted(self, wishes: Sequence[Wish]) -> Iterator[None]:
        """While entered, these fields are heard."""
        with self._lock:
            for wish in wishes:
                self._plots.setdefault(wish, _Plot()).pages += 1
        try:
            yield
        finally:
            with self._lock:
                for wish in wishes:
                    self._plots[wish].pages -= 1
                    self._plots[wish].left_s = monotonic_s()

    def heard(self, wish: Wish, after_ns: int) -> Heard:
        """What came of a field that is wanted, after a time [ns since 1970]."""
        with self._lock:
            return self._plots[wish].trace.heard(after_ns)

    def turn(self, look: RosLook) -> None:
        """Take what has come, several times a second.

        Args:
            look: a participant in the stack's domain; another one means another stack.
        """
        with self._lock:
            self._forget()
            plots = list(self._plots.items())
            if look is not self._look:
                self._look = look
                for _, plot in plots:
                    plot.raw = None
        for wish, plot in plots:
            try:
                self._listen(look, wish, plot)
                if plot.raw is not None and plot.selection is not None:
                    self._take(wish, plot, plot.raw, plot.selection)
            except ObkError as error:
                plot.trace.fault = "; ".join(filter(None, (error.message, error.help)))

    def _forget(self) -> None:
        gone_s = monotonic_s() - KEPT_S
        for wish, plot in list(self._plots.items()):
            if not plot.pages and plot.left_s < gone_s:
                if plot.raw is not None:
                    plot.raw.close()
                del self._plots[wish]

    def _listen(self, look: RosLook, wish: Wish, plot: _Plot) -> None:
        """Subscribe as soon as the topic has a type, and learn of other publishers."""
        if plot.raw is not None:
            plot.raw.look()
            return
        msg_type = next(iter(look.topic(wish.topic).msg_types), None)
        if msg_type is None:
            plot.trace.fault = "nobody has this topic now"
            return
        plot.selection = parse_selection(wish.field)
        kind = check_selection(plot.selection, short_type(msg_type), fields_of)
        if isinstance(kind.item if isinstance(kind, ArrayType) else kind, Text):
            plot.trace.fault = f"`{wish.field}` is text, not numbers"
            return
        plot.raw = look.listen(wish.topic, msg_type, find_type(msg_type))
        plot.trace.fault = ""

    def _take(self, wish: Wish, plot: _Plot, raw: RawTopic, selection: Selection) -> None:
        for received_ns, message in arrived(raw, plot.trace.is_due):
            numbers = numbers_in(selected(message, selection), wish.field)
            with self._lock:
                plot.trace.take(received_ns, numbers)
