"""Watch the age of a robot's commands, and report stopped and rejected commands without a flood.

`CommandAge` is arithmetic of times, with no clock and no thread. For a real robot a
`WatchdogThread` checks it at each deadline; for a simulated one the stepping thread does so before
each step. `SilenceLog` and `RejectionLog` limit how often the log is written; they do not delay
the action on old commands.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

__all__ = [
    "ONLY_REJECTIONS",
    "SILENCE_GRACE_S",
    "SILENCE_PERIOD_S",
    "CommandAge",
    "LastingRejection",
    "RejectionLog",
    "RejectionReport",
    "SilenceLog",
    "StalePolicy",
    "WatchdogThread",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class StalePolicy:
    """The config's settings for old commands."""

    max_age_s: float
    """How old the newest command may become [s], > 0."""
    action: str
    """What the robot does then, one of `obelisk_spec.components.STALE_ACTIONS`."""


class CommandAge:
    """The age of the newest command; one thread may accept commands while another one checks.

    The age counts from the first command on: until then the robot does what it does at activation.
    """

    def __init__(self, policy: StalePolicy) -> None:
        """Start without a command."""
        self.policy = policy
        self.is_stale = False
        """Whether `look` has found the newest command too old."""
        self._newest_s: float | None = None
        self._lock = threading.Lock()

    @property
    def deadline_s(self) -> float | None:
        """When the newest command becomes too old [s]; None if it is, or there is none."""
        newest_s = self._newest_s
        return None if newest_s is None or self.is_stale else newest_s + self.policy.max_age_s

    def accept(self, now_s: float) -> float | None:
        """Note a command.

        Returns:
            Time without commands [s], if the last one was too old.
        """
        with self._lock:
            before_s, self._newest_s = self._newest_s, now_s
            was_stale, self.is_stale = self.is_stale, False
        return now_s - before_s if was_stale and before_s is not None else None

    def look(self, now_s: float) -> float | None:
        """Check whether the newest command is too old by now.

        Returns:
            Its age [s], the first time that it is found too old.
        """
        # A command's deadline only moves forward: one that lies ahead needs no lock.
        deadline_s = self.deadline_s
        if deadline_s is None or now_s <= deadline_s:
            return None
        with self._lock:
            deadline_s = self.deadline_s
            if deadline_s is None or now_s <= deadline_s:
                return None
            self.is_stale = True
            return now_s - deadline_s + self.policy.max_age_s

    def silence_s(self, now_s: float) -> float | None:
        """Time since the newest command [s], if it was found too old."""
        with self._lock:
            return now_s - self._newest_s if self.is_stale and self._newest_s is not None else None

    def postpone(self, now_s: float) -> None:
        """Count from now, without a command: the time until now was a pause."""
        with self._lock:
            if self._newest_s is not None and not self.is_stale:
                self._newest_s = now_s

    def forget(self) -> None:
        """Return to the state before the first command."""
        with self._lock:
            self._newest_s = None
            self.is_stale = False


class WatchdogThread:
    """A thread that wakes when a robot's newest command becomes too old.

    It calls back on its own thread, so an executor that is busy does not delay it. It sleeps from
    one deadline to the next, so commands that come in time cost nothing.
    """

    def __init__(self, deadline_s: Callable[[], float | None], check: Callable[[], None]) -> None:
        """Make a thread that does not run yet.

        Args:
            deadline_s: returns the next deadline, a time of `time.monotonic`, or None.
            check: called at each deadline; afterwards the deadline must have moved.
        """
        self._deadline_s = deadline_s
        self._check = check
        self._woken = threading.Event()
        self._is_ended = False
        self._thread = threading.Thread(target=self._run, name="command watchdog", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def wake(self) -> None:
        """Check the deadline again, after there was none."""
        self._woken.set()

    def stop(self, timeout_s: float) -> bool:
        """Stop the thread; false if it still runs after `timeout_s` [s], which one call waits."""
        was_ended, self._is_ended = self._is_ended, True
        self._woken.set()
        self._thread.join(0 if was_ended else timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._is_ended:
            deadline_s = self._deadline_s()
            left_s = None if deadline_s is None else deadline_s - time.monotonic()
            if left_s is None or left_s > 0:
                self._woken.wait(None if left_s is None else min(left_s, threading.TIMEOUT_MAX))
                self._woken.clear()
            else:
                self._check()


SILENCE_GRACE_S: Final = 0.5
"""How long commands have stopped before that is logged [s]: a stack that shuts down stops its
controllers before its robot, which is no fault."""
SILENCE_PERIOD_S: Final = 10.0
"""Shortest time between two reports of stopped commands [s]."""


class SilenceLog:
    """When the log reports that commands stopped: at most once in ten seconds; thread-safe."""

    def __init__(self) -> None:
        """Make an empty log."""
        self.due_s: float | None = None
        """When the next report is due; None if there is nothing to report."""
        self._lock = threading.Lock()
        self._last_report_s = -float("inf")
        self._count = 0
        self._longest_s = 0.0
        self._is_reported = False

    def begin(self, now_s: float) -> None:
        """Note that commands have stopped."""
        with self._lock:
            self._count += 1
            if self.due_s is None:
                self.due_s = max(now_s + SILENCE_GRACE_S, self._last_report_s + SILENCE_PERIOD_S)

    def end(self, silent_s: float) -> bool:
        """Note that commands resumed; returns whether the log had reported that they stopped."""
        with self._lock:
            self._longest_s = max(self._longest_s, silent_s)
            was_reported, self._is_reported = self._is_reported, False
            return was_reported

    def report(self, now_s: float, silent_s: float | None) -> str:
        """A clause about everything not yet reported, at `due_s` or later.

        Args:
            now_s: the present time.
            silent_s: time since the newest command [s]; None if commands resumed.
        """
        with self._lock:
            self.due_s, self._last_report_s = None, now_s
            count, self._count = self._count, 0
            longest_s, self._longest_s = self._longest_s, 0.0
            self._is_reported = silent_s is not None
        if silent_s is None:
            return f"commands stopped {count}x, for {longest_s:.3f} s at most"
        if count > 1:
            return f"commands stopped {count}x, and none has come for {silent_s:.3f} s"
        return f"no command for {silent_s:.3f} s"

    def forget(self) -> None:
        """Drop everything not yet reported."""
        with self._lock:
            self.due_s, self._is_reported = None, False
            self._count, self._longest_s = 0, 0.0


REPORT_PERIOD_S: Final = 1.0
LASTING_S: Final = 1.0
"""After so long with rejections only, they are reported as an error [s]."""
LASTING_PERIOD_S: Final = 10.0
"""Time between two such errors [s]."""
MOST_REASONS: Final = 8
"""Reasons in one report; further ones, as with a number that grows, are only counted."""
ONLY_REJECTIONS: Final = (
    "nothing else was received for {lasting_s:.1f} s, so the robot has no commands; "
    "`obk topic echo` shows what the controller sends"
)
"""The end of a report when all control messages are rejected."""


class RejectionReport(NamedTuple):
    """A sentence for the log."""

    text: str
    is_lasting: bool
    """Whether nothing was accepted for a while, which is an error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LastingRejection:
    """Messages are received, and all of them are rejected."""

    seconds: float
    """From the first to the newest of them [s]."""
    reason: str
    """Why the newest was rejected."""


class RejectionLog:
    """Rejected messages, counted by reason and reported at most once a second; thread-safe."""

    def __init__(
        self, what: str, monotonic_s: Callable[[], float], on_end: str | None = None
    ) -> None:
        """Make an empty log.

        Args:
            what: the start of each report, "control rejected".
            monotonic_s: clock for the rate of reports [s].
            on_end: what a report adds if nothing was accepted for a while, with `{lasting_s}`;
                None: nothing.
        """
        self._what = what
        self._monotonic_s = monotonic_s
        self._on_end = on_end
        self._lock = threading.Lock()
        self._unreported: Counter[str] = Counter()
        self._others = 0
        self._total = 0
        self._next_report_s = -float("inf")
        self._since_s: float | None = None
        self._newest_s = 0.0
        self._newest_reason = ""

    def add(self, reason: str) -> None:
        """Count a rejection."""
        with self._lock:
            if reason in self._unreported or len(self._unreported) < MOST_REASONS:
                self._unreported[reason] += 1
            else:
                self._others += 1
            self._total += 1
            self._newest_s = self._monotonic_s()
            self._newest_reason = reason
            if self._since_s is None:
                self._since_s = self._newest_s

    def accept(self) -> None:
        """Note that a message was accepted, or that counting starts again."""
        self._since_s = None

    def lasting(self) -> LastingRejection | None:
        """The rejections since something was accepted; None if they are not spread over 1 s."""
        with self._lock:
            seconds = 0.0 if self._since_s is None else self._newest_s - self._since_s
            if seconds < LASTING_S:
                return None
            return LastingRejection(seconds=seconds, reason=self._newest_reason)

    def report(self) -> RejectionReport | None:
        """A sentence about everything not yet reported, at most once a second."""
        now_s = self._monotonic_s()
        with self._lock:
            if not self._unreported or now_s < self._next_report_s:
                return None
            since_s = self._since_s
            lasting_s = 0.0 if since_s is None else now_s - since_s
            is_lasting = self._on_end is not None and lasting_s >= LASTING_S
            self._next_report_s = now_s + (LASTING_PERIOD_S if is_lasting else REPORT_PERIOD_S)
            reasons = "; ".join(
                f"{reason} ({count}x)" for reason, count in self._unreported.items()
            )
            if self._others:
                reasons = f"{reasons}; for further reasons ({self._others}x)"
            self._unreported.clear()
            self._others = 0
            text = f"{self._what}: {reasons}; {self._total} since the start"
            if self._on_end is not None and is_lasting:
                text = f"{text}; {self._on_end.format(lasting_s=lasting_s)}"
            return RejectionReport(text, is_lasting)
