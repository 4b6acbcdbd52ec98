"""Run requests of other threads on the stepping thread: `~/reset`, `~/pause`, `~/step`.

The node's thread receives the service requests, and other threads those of viewers. The stepping
thread runs their actions between two steps. No other thread touches the simulation.
"""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as AnswerTimeoutError
from typing import Any, Final, NamedTuple

from std_srvs.srv import SetBool, Trigger

__all__ = ["StepQueue", "StepResult", "make_step_services"]

_ANSWER_S: Final = 2.0
"""Timeout for a response; a running simulation responds between two steps [s]."""


class StepResult(NamedTuple):
    """The result of an action."""

    is_done: bool
    text: str


class StepQueue:
    """Actions for the stepping thread, and whether it is paused."""

    def __init__(self, *, is_stepping: Callable[[], bool], is_immediate: bool = False) -> None:
        """Create an empty queue for a simulation that is not paused.

        Args:
            is_stepping: returns whether a stepping thread runs the actions.
            is_immediate: whether the caller's thread is the stepping thread, so that nothing waits.
        """
        self._is_stepping = is_stepping
        self._is_immediate = is_immediate
        self.is_paused = False
        """Whether steps are taken only on request; only the stepping thread may use it."""
        self._waiting: deque[tuple[Callable[[], StepResult], Future[StepResult]]] = deque()
        self._arrived = threading.Event()

    def submit(self, action: Callable[[], StepResult]) -> Future[StepResult]:
        """Queue an action for the stepping thread."""
        answer: Future[StepResult] = Future()
        self._waiting.append((action, answer))
        if self._is_immediate:
            self.run_pending()
        else:
            self._arrived.set()
        return answer

    def ask(self, action: Callable[[], StepResult]) -> StepResult:
        """Run an action on the stepping thread and wait for its result, for at most 2 s."""
        if not self._is_stepping():
            return StepResult(is_done=False, text="the simulator is not active")
        pending = self.submit(action)
        try:
            return pending.result(_ANSWER_S)
        except AnswerTimeoutError:
            # A started action cannot be undone; a waiting one is cancelled.
            pending.cancel()
            text = f"the simulation did not respond within {_ANSWER_S:g} s"
            return StepResult(is_done=False, text=text)

    def ask_pause(self, is_paused: bool) -> StepResult:
        """Pause the simulation, or continue it."""

        def pause() -> StepResult:
            self.is_paused = is_paused
            return StepResult(is_done=True, text="paused" if is_paused else "running")

        return self.ask(pause)

    def ask_step(self, step: Callable[[], StepResult]) -> StepResult:
        """Take one step, if the simulation is paused."""

        def step_if_paused() -> StepResult:
            if not self.is_paused:
                return StepResult(is_done=False, text="the simulation is running; pause it first")
            return step()

        return self.ask(step_if_paused)

    def is_waiting(self) -> bool:
        """Whether an action is waiting."""
        return self._arrived.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for an action, for at most `timeout_s` [s]."""
        self._arrived.wait(timeout_s)

    def run_pending(self) -> None:
        """Run all waiting actions.

        It raises the exception of an action, which the caller's future receives too.
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


def make_step_services(
    create: Callable[[type[Any], str, Callable[[Any, Any], Any]], Any],
    requests: StepQueue,
    *,
    reset: Callable[[], StepResult],
    step: Callable[[], StepResult],
) -> list[Any]:
    """Create the services.

    Args:
        create: `Node.create_service` (type, name, callback).
        requests: actions for the stepping thread.
        reset: resets to the keyframe; called on the stepping thread.
        step: takes one step; called on the stepping thread while the simulation is paused.
    """

    def on_reset(_request: Any, response: Any) -> Any:
        response.success, response.message = requests.ask(reset)
        return response

    def on_pause(request: Any, response: Any) -> Any:
        response.success, response.message = requests.ask_pause(request.data)
        return response

    def on_step(_request: Any, response: Any) -> Any:
        response.success, response.message = requests.ask_step(step)
        return response

    return [
        create(Trigger, "~/reset", on_reset),
        create(SetBool, "~/pause", on_pause),
        create(Trigger, "~/step", on_step),
    ]
