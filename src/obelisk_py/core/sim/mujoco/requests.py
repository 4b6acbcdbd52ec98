"""What others ask of a simulation while it is stepped: each is done between two steps.

In: actions, from any thread. Out: the same actions carried out on the thread that steps, and what
came of them. Nobody but that thread ever touches the simulation.
"""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import NamedTuple

__all__ = ["Answer", "StepRequests"]


class Answer(NamedTuple):
    """What came of an action."""

    is_done: bool
    text: str


class StepRequests:
    """Actions that wait for the stepping thread, and whether it stands still."""

    def __init__(self) -> None:
        """Make an empty queue of a simulation that is not paused."""
        self.is_paused = False
        """Whether steps are taken only when asked for; belongs to the stepping thread."""
        self._waiting: deque[tuple[Callable[[], Answer], Future[Answer]]] = deque()
        self._arrived = threading.Event()

    def ask(self, action: Callable[[], Answer]) -> Future[Answer]:
        """Have an action carried out on the stepping thread."""
        answer: Future[Answer] = Future()
        self._waiting.append((action, answer))
        self._arrived.set()
        return answer

    def is_waiting(self) -> bool:
        """Whether there is an action to carry out."""
        return self._arrived.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for an action, for `timeout_s` at most."""
        self._arrived.wait(timeout_s)

    def carry_out(self) -> None:
        """Carry out what waits.

        Raises what an action raises, which the one who asked is told as well.
        """
        self._arrived.clear()
        while self._waiting:
            action, answer = self._waiting.popleft()
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(action())
            except Exception as error:
                answer.set_exception(error)
                raise
