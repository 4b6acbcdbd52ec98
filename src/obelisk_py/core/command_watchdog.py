"""Watch the age of a robot's commands, and log missing and rejected commands at a limited rate.

`CommandAge` only does arithmetic on times; it has neither a clock nor a thread. A real robot's
`WatchdogThread` checks it at each deadline. A simulated robot's stepping thread checks it before
each step. `SilenceLog` and `RejectionLog` limit the rate of log messages; they do not delay the
response to stale commands.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from obelisk_spec.suggestions import with_number

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
    """The config's settings for stale commands."""

    max_age_s: float
    """Age at which the latest command is stale [s], > 0."""
    action: str
    """The robot's response, one of `obelisk_spec.components.STALE_ACTIONS`."""


class CommandAge:
    """The age of the latest command; one thread may accept commands while another one checks.

    Nothing is stale before the first command: until then, the robot keeps doing whatever it did on
    activation.
    """

    def __init__(self, policy: StalePolicy) -> None:
        """Start without a command."""
        self.policy = policy
        self.is_stale = False
        """Whether `look` found the latest command stale."""
        self._newest_s: float | None = None
        self._lock = threading.Lock()

    @property
    def deadline_s(self) -> float | None:
        """When the latest command becomes stale [s]; None if there is none, or if it is stale."""
        newest_s = self._newest_s
        return None if newest_s is None or self.is_stale else newest_s + self.policy.max_age_s

    def accept(self, now_s: float) -> float | None:
        """Record a new command.

        Returns:
            Time without commands [s] if the previous one was stale, otherwise None.
        """
        with self._lock:
            before_s, self._newest_s = self._newest_s, now_s
            was_stale, self.is_stale = self.is_stale, False
        return now_s - before_s if was_stale and before_s is not None else None

    def look(self, now_s: float) -> float | None:
        """Check whether the latest command is stale.

        Returns:
            The command's age [s] when it is first found stale, otherwise None.
        """
        # Deadlines only move forward, so a deadline in the future needs no lock.
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
        """Time since the latest command [s] if it is stale, otherwise None."""
        with self._lock:
            return now_s - self._newest_s if self.is_stale and self._newest_s is not None else None

    def postpone(self, now_s: float) -> None:
        """Reset the age of the latest command to zero, because the robot was paused."""
        with self._lock:
            if self._newest_s is not None and not self.is_stale:
                self._newest_s = now_s

    def forget(self) -> None:
        """Return to the state before the first command."""
        with self._lock:
            self._newest_s = None
            self.is_stale = False


class WatchdogThread:
    """A thread that wakes when a robot's latest command becomes stale.

    It calls `check` itself, so a busy executor does not delay it. It sleeps from one deadline to
    the next, so commands that arrive in time cost nothing.
    """

    def __init__(self, deadline_s: Callable[[], float | None], check: Callable[[], None]) -> None:
        """Create the thread without starting it.

        Args:
            deadline_s: returns the next deadline on the clock of `time.monotonic` [s], or None.
            check: called at each deadline; must move the deadline.
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
        """Read the deadline again; call this when a deadline is set and there was none before."""
        self._woken.set()

    def stop(self, timeout_s: float) -> bool:
        """Stop the thread; false if it is still running after `timeout_s` [s].

        Only the first call waits.
        """
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
"""Delay before missing commands are logged [s]. During a normal shutdown, the controllers stop
shortly before the robot."""
SILENCE_PERIOD_S: Final = 10.0
"""Minimum time between two reports of missing commands [s]."""


class SilenceLog:
    """Reports missing commands at most once every 10 s; thread-safe."""

    def __init__(self) -> None:
        """Create an empty log."""
        self.due_s: float | None = None
        """When the next report is due; None if there is nothing to report."""
        self._lock = threading.Lock()
        self._last_report_s = -float("inf")
        self._count = 0
        self._longest_s = 0.0
        self._is_reported = False

    def begin(self, now_s: float) -> None:
        """Record that commands have stopped."""
        with self._lock:
            self._count += 1
            if self.due_s is None:
                self.due_s = max(now_s + SILENCE_GRACE_S, self._last_report_s + SILENCE_PERIOD_S)

    def end(self, silent_s: float) -> bool:
        """Record that commands resumed.

        Returns:
            Whether `report` had reported that they stopped.
        """
        with self._lock:
            self._longest_s = max(self._longest_s, silent_s)
            was_reported, self._is_reported = self._is_reported, False
            return was_reported

    def report(self, now_s: float, silent_s: float | None) -> str:
        """Return a clause that summarizes everything unreported; call it at `due_s` or later.

        Args:
            now_s: current time [s].
            silent_s: time since the latest command [s]; None if commands resumed.
        """
        with self._lock:
            self.due_s, self._last_report_s = None, now_s
            count, self._count = self._count, 0
            longest_s, self._longest_s = self._longest_s, 0.0
            self._is_reported = silent_s is not None
        if silent_s is None:
            return f"commands stopped {with_number(count, 'time')}, for up to {longest_s:.3f} s"
        if count > 1:
            return (
                f"commands stopped {with_number(count, 'time')}, most recently for {silent_s:.3f} s"
            )
        return f"no command for {silent_s:.3f} s"

    def forget(self) -> None:
        """Drop everything unreported."""
        with self._lock:
            self.due_s, self._is_reported = None, False
            self._count, self._longest_s = 0, 0.0


WARNING_PERIOD_S: Final = 1.0
LASTING_S: Final = 1.0
"""If every message is rejected for this long [s], the report is an error."""
LASTING_PERIOD_S: Final = 10.0
"""Time between two such errors [s]."""
MOST_REASONS: Final = 8
"""Maximum number of reasons in a report. Further reasons are only counted; otherwise, a reason that
contains a changing number would fill the report."""
ONLY_REJECTIONS: Final = (
    "no valid message has been received for {lasting_s:.1f} s, so the robot has no commands; "
    "`obk topic echo` shows what the controller sends"
)
"""Appended to a report when every control message is rejected."""


class RejectionReport(NamedTuple):
    """A sentence for the log."""

    text: str
    is_lasting: bool
    """Whether every message was rejected for `LASTING_S`, which is an error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LastingRejection:
    """A period in which every received message was rejected."""

    seconds: float
    """Time from the first rejection to the latest [s]."""
    reason: str
    """The reason for the latest rejection."""


class RejectionLog:
    """Rejected messages, counted by reason and reported at most once a second; thread-safe."""

    def __init__(
        self, what: str, monotonic_s: Callable[[], float], on_end: str | None = None
    ) -> None:
        """Create an empty log.

        Args:
            what: the start of each report, such as "control rejected".
            monotonic_s: clock that limits the rate of reports [s].
            on_end: text with `{lasting_s}`, appended to a report if every message was rejected for
                `LASTING_S`; None appends nothing and reports no error.
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
        """Record an accepted message; also call this to restart the measurement."""
        self._since_s = None

    def lasting(self) -> LastingRejection | None:
        """The rejections since the last accepted message; None if they span less than 1 s."""
        with self._lock:
            seconds = 0.0 if self._since_s is None else self._newest_s - self._since_s
            if seconds < LASTING_S:
                return None
            return LastingRejection(seconds=seconds, reason=self._newest_reason)

    def report(self, *, is_last: bool = False) -> RejectionReport | None:
        """Return a sentence that summarizes everything unreported, at most once a second.

        After an error, the next report follows 10 s later.

        Args:
            is_last: report even if the next report is not due.

        Returns:
            None if there is nothing to report or the next report is not due.
        """
        if not self._unreported:  # the usual case: read no clock, take no lock
            return None
        now_s = self._monotonic_s()
        with self._lock:
            if now_s < self._next_report_s and not is_last:
                return None
            since_s = self._since_s
            lasting_s = 0.0 if since_s is None else now_s - since_s
            is_lasting = self._on_end is not None and lasting_s >= LASTING_S
            self._next_report_s = now_s + (LASTING_PERIOD_S if is_lasting else WARNING_PERIOD_S)
            reasons = "; ".join(
                f"{reason} ({count}x)" for reason, count in self._unreported.items()
            )
            if self._others:
                reasons = f"{reasons}; other reasons ({self._others}x)"
            self._unreported.clear()
            self._others = 0
            text = f"{self._what}: {reasons}; {self._total} in total"
            if self._on_end is not None and is_lasting:
                text = f"{text}; {self._on_end.format(lasting_s=lasting_s)}"
            return RejectionReport(text, is_lasting)
