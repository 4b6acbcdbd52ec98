"""Requests to a simulation are executed in order, on the stepping thread, or fail with a reason."""

from concurrent.futures import Future

import pytest

from obelisk_py.core.sim.mujoco.step_queue import StepQueue, StepResult

pytestmark = pytest.mark.mujoco


def _done(text):
    return lambda: StepResult(is_done=True, text=text)


def test_actions_are_executed_in_order_of_arrival():
    requests = StepQueue(is_stepping=lambda: True)
    asked = [requests.submit(_done(text)) for text in ("one", "two")]
    assert requests.is_waiting()
    assert not any(answer.done() for answer in asked)
    requests.run_pending()
    assert [answer.result(0).text for answer in asked] == ["one", "two"]
    assert not requests.is_waiting()


def test_a_canceled_request_is_not_executed():
    requests, carried_out = StepQueue(is_stepping=lambda: True), []
    given_up: Future = requests.submit(lambda: carried_out.append("given up"))
    wanted = requests.submit(_done("wanted"))
    assert given_up.cancel()
    requests.run_pending()
    assert carried_out == []
    assert wanted.result(0).is_done


def test_a_fault_is_reported_on_both_ends():
    def fail():
        raise RuntimeError("the simulation diverged")

    requests = StepQueue(is_stepping=lambda: True)
    answer = requests.submit(fail)
    with pytest.raises(RuntimeError, match="diverged"):
        requests.run_pending()
    with pytest.raises(RuntimeError, match="diverged"):
        answer.result(0)
