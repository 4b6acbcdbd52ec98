"""Run requests of other threads on the stepping thread: `~/reset`, `~/pause`, `~/step`.

In: service requests, on the node's thread. Out: actions run between two steps on the stepping
thread, and their results as responses. No other thread touches the simulation.
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
"""A simulation that steps answers between two steps [s]."""


class StepResult(NamedTuple):
    """The result of an action."""

    is_done: bool
    text: str


class StepQueue:
    """Actions that wait for the stepping thread, and whether it is paused."""

    def __init__(self, *, is_immediate: bool = False) -> None:
        """Make an empty queue of a simulation that is not paused.

        Args:
            is_immediate: the caller's thread is the stepping thread, so nothing has to wait.
        """
        self._is_immediate = is_immediate
        self.is_paused = False
        """Whether steps are taken only when asked for; belongs to the stepping thread."""
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

    def is_waiting(self) -> bool:
        """Whether an action is waiting."""
        return self._arrived.is_set()

    def wait(self, timeout_s: float) -> None:
        """Wait for an action, for `timeout_s` at most."""
        self._arrived.wait(timeout_s)

    def run_pending(self) -> None:
        """Carry out what waits.

        Raises what an action raises; the future of its caller gets the same exception.
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
    is_stepping: Callable[[], bool],
    reset: Callable[[], StepResult],
    step: Callable[[], StepResult],
) -> list[Any]:
    """The services, made by `create` (type, name, callback).

    Args:
        create: `Node.create_service`.
        requests: what the stepping thread carries out.
        is_stepping: whether there is a thread that carries requests out.
        reset: goes to the keyframe; called on the stepping thread.
        step: takes one step; called on the stepping thread, while the simulation is paused.
    """

    def answered(action: Callable[[], StepResult], response: Any) -> Any:
        if is_stepping():
            return _answered(requests, action, response)
        response.success, response.message = False, "the simulator is not active"
        return response

    def on_reset(_request: Any, response: Any) -> Any:
        return answered(reset, response)

    def on_pause(request: Any, response: Any) -> Any:
        def pause() -> StepResult:
            requests.is_paused = request.data
            return StepResult(is_done=True, text="paused" if request.data else "running")

        return answered(pause, response)

    def on_step(_request: Any, response: Any) -> Any:
        def step_if_paused() -> StepResult:
            if not requests.is_paused:
                return StepResult(is_done=False, text="the simulation is running; pause it first")
            return step()

        return answered(step_if_paused, response)

    return [
        create(Trigger, "~/reset", on_reset),
        create(SetBool, "~/pause", on_pause),
        create(Trigger, "~/step", on_step),
    ]


def _answered(requests: StepQueue, action: Callable[[], StepResult], response: Any) -> Any:
    asked = requests.submit(action)
    try:
        response.success, response.message = asked.result(_ANSWER_S)
    except AnswerTimeoutError:
        # A started action cannot be undone; one that has not started is cancelled.
        asked.cancel()
        response.success = False
        response.message = f"the simulation gave no answer within {_ANSWER_S:g} s"
    return response
