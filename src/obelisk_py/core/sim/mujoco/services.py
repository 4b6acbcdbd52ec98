"""Services of a simulator: `~/reset`, `~/pause`, `~/step`.

In: requests, on the node's thread. Out: answers, once the stepping thread has done what was asked.
"""

from collections.abc import Callable
from concurrent.futures import TimeoutError as AnswerTimeoutError
from typing import Any, Final

from std_srvs.srv import SetBool, Trigger

from obelisk_py.core.sim.mujoco.requests import Answer, StepRequests

__all__ = ["make_services"]

_ANSWER_S: Final = 2.0
"""A simulation that steps answers between two steps [s]."""


def make_services(
    create: Callable[[type[Any], str, Callable[[Any, Any], Any]], Any],
    requests: StepRequests,
    *,
    is_stepping: Callable[[], bool],
    reset: Callable[[], Answer],
    step: Callable[[], Answer],
) -> list[Any]:
    """The services, made by `create` (type, name, callback).

    Args:
        create: `Node.create_service`.
        requests: what the stepping thread carries out.
        is_stepping: whether there is a thread that carries requests out.
        reset: goes to the keyframe; called on the stepping thread.
        step: takes one step; called on the stepping thread, while the simulation is paused.
    """

    def answered(action: Callable[[], Answer], response: Any) -> Any:
        if is_stepping():
            return _answered(requests, action, response)
        response.success, response.message = False, "the simulator is not active"
        return response

    def on_reset(_request: Any, response: Any) -> Any:
        return answered(reset, response)

    def on_pause(request: Any, response: Any) -> Any:
        def pause() -> Answer:
            requests.is_paused = request.data
            return Answer(is_done=True, text="paused" if request.data else "running")

        return answered(pause, response)

    def on_step(_request: Any, response: Any) -> Any:
        def step_if_paused() -> Answer:
            if not requests.is_paused:
                return Answer(is_done=False, text="the simulation is running; pause it first")
            return step()

        return answered(step_if_paused, response)

    return [
        create(Trigger, "~/reset", on_reset),
        create(SetBool, "~/pause", on_pause),
        create(Trigger, "~/step", on_step),
    ]


def _answered(requests: StepRequests, action: Callable[[], Answer], response: Any) -> Any:
    asked = requests.ask(action)
    try:
        response.success, response.message = asked.result(_ANSWER_S)
    except AnswerTimeoutError:
        # What has been begun cannot be taken back; what has not is not done later.
        asked.cancel()
        response.success = False
        response.message = f"the simulation gave no answer within {_ANSWER_S:g} s"
    return response
