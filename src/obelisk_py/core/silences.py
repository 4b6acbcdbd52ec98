"""When the log is told that commands stopped: not of each silence where they come now and then.

In: silences that begin and end, in times [s] of a steady clock. Out: half a sentence, at most one
each ten seconds. What is done about a silence does not wait for this.
"""

import threading
from typing import Final

__all__ = ["GRACE_S", "PERIOD_S", "Silences"]

GRACE_S: Final = 0.5
"""How long a silence is known before it is told [s]: a stack that comes down ends its controllers
before its robot, which is no fault."""
PERIOD_S: Final = 10.0
"""From one report to the next, at least [s]."""


class Silences:
    """Those that no report has told yet; may be filled and asked on several threads."""

    def __init__(self) -> None:
        """Begin with none."""
        self.due_s: float | None = None
        """When the next report is due; None where there is nothing to tell."""
        self._lock = threading.Lock()
        self._last_report_s = -float("inf")
        self._count = 0
        self._longest_s = 0.0
        self._is_told = False

    def begin(self, now_s: float) -> None:
        """Count a silence that has begun."""
        with self._lock:
            self._count += 1
            if self.due_s is None:
                self.due_s = max(now_s + GRACE_S, self._last_report_s + PERIOD_S)

    def end(self, silent_s: float) -> bool:
        """Note how long the silence was that ends now; whether it was told while it lasted."""
        with self._lock:
            self._longest_s = max(self._longest_s, silent_s)
            was_told, self._is_told = self._is_told, False
            return was_told

    def report(self, now_s: float, silent_s: float | None) -> str:
        """Tell all that is not told, at `due_s` or later.

        Args:
            now_s: the time.
            silent_s: how long no command has come [s]; None where they come again.
        """
        with self._lock:
            self.due_s, self._last_report_s = None, now_s
            count, self._count = self._count, 0
            longest_s, self._longest_s = self._longest_s, 0.0
            self._is_told = silent_s is not None
        if silent_s is None:
            return f"commands stopped {count}x, for {longest_s:.3f} s at most"
        if count > 1:
            return f"commands stopped {count}x, and none has come for {silent_s:.3f} s"
        return f"no command for {silent_s:.3f} s"

    def forget(self) -> None:
        """Drop what is not told."""
        with self._lock:
            self.due_s, self._is_told = None, False
            self._count, self._longest_s = 0, 0.0
