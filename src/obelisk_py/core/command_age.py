"""When a robot's newest command is too old: arithmetic of times, no clock and no thread.

In: times [s] of a steady clock, at which commands were accepted and at which somebody looks. Out:
the age, once, when the newest command has become too old; how long none came, once, when the next
one comes.
"""

import threading
from dataclasses import dataclass

__all__ = ["CommandAge", "StalePolicy"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StalePolicy:
    """What the config says about old commands."""

    max_age_s: float
    """How old the newest command may become [s], > 0."""
    action: str
    """What the robot does then, one of `obelisk_spec.components.STALE_ACTIONS`."""


class CommandAge:
    """The age of the newest command; may be told of commands on one thread and asked on another.

    Nothing is counted before the first command: until then the robot does what it does at
    activation.
    """

    def __init__(self, policy: StalePolicy) -> None:
        """Begin with no command."""
        self.policy = policy
        self.is_stale = False
        """Whether the newest command is known to be too old."""
        self._newest_s: float | None = None
        self._lock = threading.Lock()

    @property
    def deadline_s(self) -> float | None:
        """When the newest command becomes too old [s]; None while nothing is counted."""
        newest_s = self._newest_s
        return None if newest_s is None or self.is_stale else newest_s + self.policy.max_age_s

    def accept(self, now_s: float) -> float | None:
        """Count anew from a command.

        Returns:
            How long none had come [s], if the last one was known to be too old.
        """
        with self._lock:
            before_s, self._newest_s = self._newest_s, now_s
            was_stale, self.is_stale = self.is_stale, False
        return now_s - before_s if was_stale and before_s is not None else None

    def look(self, now_s: float) -> float | None:
        """Find out whether the newest command is too old by now.

        Returns:
            Its age [s], if it was not known to be too old.
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
        """How long no command has come [s], where the newest is known to be too old."""
        with self._lock:
            return now_s - self._newest_s if self.is_stale and self._newest_s is not None else None

    def postpone(self, now_s: float) -> None:
        """Count anew without a command: the time up to now is nobody's fault."""
        with self._lock:
            if self._newest_s is not None and not self.is_stale:
                self._newest_s = now_s

    def forget(self) -> None:
        """Begin with no command again."""
        with self._lock:
            self._newest_s = None
            self.is_stale = False
