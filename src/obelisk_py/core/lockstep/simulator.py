"""A simulated robot whose steps are events."""

import threading
from collections.abc import Callable
from typing import Any

from obelisk_py.core.lockstep.scheduler import STEP, ScheduledNode, Scheduler
from obelisk_py.core.surroundings import SteppedRobot

__all__ = ["StepEvents"]


class StepEvents(threading.Thread):
    """Takes the steps of a robot; stands in for its stepping thread, and is never started."""

    def __init__(self, scheduler: Scheduler, node: ScheduledNode, robot: SteppedRobot) -> None:
        """Make one that does not step yet."""
        super().__init__(name="simulator", daemon=True)
        self.robot: Any = robot
        self.before_step: list[Callable[[], None]] = []
        """Called before each step, such as what applies a force."""
        self.after_step: list[Callable[[], None]] = []
        self._scheduler = scheduler
        self._node = node
        self._guarded = node.node.guarded(self._step)
        self._is_stopped = False

    def start(self) -> None:
        """Take the first step after its time from now."""
        self._push()

    def is_alive(self) -> bool:
        """False: it stops at once."""
        return False

    def join(self, timeout: float | None = None) -> None:
        """Take no further step."""
        del timeout
        self._is_stopped = True

    def _push(self) -> None:
        due_ns = self._scheduler.now_ns + self.robot.next_step_ns()
        self._scheduler.push(due_ns, STEP, self._node, self._guarded)

    def _step(self) -> None:
        if self._is_stopped:
            return
        for call in self.before_step:
            call()
        self.robot.step_once()
        for call in self.after_step:
            call()
        self._push()
