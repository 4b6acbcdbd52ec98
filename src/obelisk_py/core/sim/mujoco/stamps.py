"""Whether a control came late or out of order, by the stamp in its header.

In: stamps and a clock [ns], both of the time that the node lives in. Out: a sentence, or None. A
control without a stamp (zero) is never late.
"""

from collections.abc import Callable
from typing import Final

from obelisk_py.core.sim.mujoco.stepping import NS_PER_S

__all__ = ["DEFAULT_LATENESS_S", "StampOrder"]

DEFAULT_LATENESS_S: Final = 1.0
"""How old a control may be when it comes before that is told, where the config names no age [s]."""


class StampOrder:
    """The stamp of the newest control."""

    def __init__(self, now_ns: Callable[[], int], lateness_s: float) -> None:
        """Begin with no control.

        Args:
            now_ns: the node's clock [ns].
            lateness_s: age of a control that is told [s].
        """
        self._now_ns = now_ns
        self._lateness_s = lateness_s
        self._newest_ns = 0

    def restart(self) -> None:
        """Begin with no control again."""
        self._newest_ns = 0

    def refusal(self, stamp_ns: int) -> str | None:
        """Why a control is to be dropped: a newer one was applied.

        A newest stamp that lies ahead of the clock orders nothing: the clock was set back, or it is
        not the sender's.
        """
        if 0 < stamp_ns < self._newest_ns <= self._now_ns():
            return "it is older than the one applied, by their stamps"
        return None

    def accept(self, stamp_ns: int) -> str | None:
        """Take a control for the newest; a sentence where it is late."""
        if stamp_ns == 0:
            return None
        self._newest_ns = stamp_ns
        if self._now_ns() - stamp_ns > self._lateness_s * NS_PER_S:
            return f"its stamp is more than {self._lateness_s:g} s old"
        return None
