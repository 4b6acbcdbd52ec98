"""The control that the simulation applies next: the newest message that can be applied.

In: control messages, on any thread. Out: an array of the actuators' size, and sentences about what
was refused. A message of the wrong length, or with a number that is not finite or too large for
MuJoCo, never gets through.
"""

import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from obelisk_py.core.exceptions import ObeliskConfigError

__all__ = ["CONTROL_FIELDS", "ControlInbox", "control_field"]

CONTROL_FIELDS: Final = ("u_mujoco", "u")
"""Fields of a control message that the simulator reads, the first that the type has."""
REPORT_PERIOD_S: Final = 1.0
LARGEST: Final = 1e10
"""MuJoCo takes a number beyond this for a fault and sets every control to zero (mjMAXVAL)."""


def control_field(message_type: type[Any]) -> str:
    """The field of a control message type that holds what the actuators get.

    Raises:
        ObeliskConfigError: it has none.
    """
    for field in CONTROL_FIELDS:
        if hasattr(message_type, field):
            return field
    raise ObeliskConfigError(
        f"the control message {message_type.__name__} has neither a field `u_mujoco` nor `u`, "
        "so the simulator cannot read what to write to the actuators"
    )


class ControlInbox:
    """Holds the newest control; may be filled on one thread and read on another."""

    def __init__(self, *, field: str, size: int, monotonic_s: Callable[[], float]) -> None:
        """Make an empty inbox.

        Args:
            field: field of the message that holds the control.
            size: number of actuators `nu`.
            monotonic_s: clock for the rate of reports [s].
        """
        self._field = field
        self._size = size
        self._monotonic_s = monotonic_s
        self._lock = threading.Lock()
        self._refused: Counter[str] = Counter()
        self._total_refused = 0
        self._last_report_s = -float("inf")
        self.newest: NDArray[np.float64] | None = None
        """The control to apply, shape `(nu,)`; None until there is one."""

    def clear(self) -> None:
        """Forget the newest control."""
        self.newest = None

    def offer(self, message: Any) -> str | None:
        """Take a control message, or refuse it.

        Returns:
            A sentence for the log if it was refused and the last one is a second old, else None.
        """
        control = np.array(getattr(message, self._field), dtype=np.float64)
        if control.shape != (self._size,):
            return self._refuse(
                f"`{self._field}` has the length {control.size}, the model takes {self._size}"
            )
        # Written so that it is false for NaN too.
        in_range = np.abs(control) <= LARGEST
        if not in_range.all():
            index = int(np.flatnonzero(~in_range)[0])
            return self._refuse(f"`{self._field}[{index}]` is {control[index]:g}")
        self.newest = control
        return None

    def report(self) -> str | None:
        """A sentence about refusals that no log line has told yet, at most once per second."""
        now_s = self._monotonic_s()
        with self._lock:
            if not self._refused or now_s - self._last_report_s < REPORT_PERIOD_S:
                return None
            self._last_report_s = now_s
            reasons = "; ".join(f"{reason} ({count}x)" for reason, count in self._refused.items())
            self._refused.clear()
            return f"control refused: {reasons}; {self._total_refused} since the start"

    def _refuse(self, reason: str) -> str | None:
        with self._lock:
            self._refused[reason] += 1
            self._total_refused += 1
        return self.report()
