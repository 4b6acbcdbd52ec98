"""Messages held back for some simulation time.

In: messages with the step that they were sampled after. Out: the same messages in the same order,
after the step that reaches their time plus the delay. Their stamps stay those of the sample.
"""

import sys
from collections import deque
from typing import Any, Final

from obelisk_py.core.sim.mujoco.stepping import whole_steps

__all__ = ["DelayLine"]

_NEVER: Final = sys.maxsize


class DelayLine:
    """Holds messages back; as the times of an output it says when the next one is due."""

    def __init__(self, *, delay_s: float, step_s: float) -> None:
        """Make an empty line.

        Args:
            delay_s: how long a message is held back [s], > 0.
            step_s: simulation time of a step [s].
        """
        self._steps = whole_steps(delay_s, step_s)
        self._held: deque[tuple[int, Any]] = deque()

    @property
    def next_step(self) -> int:
        """The step after which the next message is due."""
        return self._held[0][0] if self._held else _NEVER

    def hold(self, message: Any, step: int) -> None:
        """Take a message that was sampled after `step`."""
        self._held.append((step + self._steps, message))

    def release(self) -> Any:
        """The message that is due next; there must be one."""
        return self._held.popleft()[1]

    def pass_step(self, step: int) -> None:
        """Nothing to look for: what is held says when it is due."""

    def restart(self) -> None:
        """Forget all messages."""
        self._held.clear()
