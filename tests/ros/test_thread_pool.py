"""Executors that programs choose: transitions that destroy due timers, parallel groups."""

from collections.abc import Callable
from threading import Event, Thread
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from obelisk_py.core.executor import EventLoopExecutor
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.spinning import _End, _make_executor

from .stack import DEADLINE_S, eventually, parameters, request, spinning

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("ros_domain")]

TIMERS = 8
ROUNDS = 40
ENOUGH = 5


class Busy(ObeliskNode):
    """Timers that are always due."""

    def __init__(self, **given: Any) -> None:
        settings = {f"timer_{n}_setting": "{timer_period_sec: 0.0005}" for n in range(TIMERS)}
        super().__init__("busy", **parameters(**settings), **given)
        for name in settings:
            self.register_obk_timer(name, self.pass_by)

    def pass_by(self) -> None:
        """Do nothing."""


@pytest.fixture(params=["rclpy", ""], ids=["of rclpy", "of the library"])
def chosen(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The executor that a program gets if it names one of rclpy's."""
    monkeypatch.setenv("OBK_EXECUTOR", request.param)
    return str(request.param)


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_the_library_runs_programs_that_name_an_executor(
    chosen: str, kind: Callable[[], Executor]
) -> None:
    rclpy.init()
    executor = _make_executor(kind)
    executor.shutdown()
    rclpy.shutdown()
    assert isinstance(executor, kind if chosen else EventLoopExecutor)


class Asking(ObeliskNode):
    """A timer that waits for a service of the same node, in separate callback groups."""

    def __init__(self, **given: Any) -> None:
        super().__init__("asking", **given)
        groups = [MutuallyExclusiveCallbackGroup() for _ in range(3)]
        self.answers = 0
        self.asked = self.create_client(Trigger, "~/answer", callback_group=groups[0])
        self.create_service(Trigger, "~/answer", self.answer, callback_group=groups[1])
        self.create_timer(0.01, self.ask, callback_group=groups[2])

    def answer(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Respond to the request."""
        response.success = True
        return response

    def ask(self) -> None:
        """Wait for the response, until there are enough: rclpy's executor may end before one."""
        if self.answers < ENOUGH:
            self.answers += self.asked.call(Trigger.Request()).success


@pytest.mark.usefixtures("chosen")
def test_callback_groups_run_in_parallel() -> None:
    with spinning(Asking, lambda: _make_executor(MultiThreadedExecutor)) as node:
        eventually(lambda: node.answers >= ENOUGH, "five answers")


class Patient(Node):
    """Waits in a callback for the response of its own service, which answers when allowed to."""

    def __init__(self) -> None:
        super().__init__("patient")
        groups = [MutuallyExclusiveCallbackGroup() for _ in range(3)]
        self.is_asked, self.may_answer = Event(), Event()
        self.asked = self.create_client(Trigger, "~/answer", callback_group=groups[0])
        self.create_service(Trigger, "~/answer", self.answer, callback_group=groups[1])
        self.create_timer(0.01, self.ask, callback_group=groups[2])

    def answer(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Respond once allowed."""
        self.is_asked.set()
        self.may_answer.wait(DEADLINE_S)
        return response

    def ask(self) -> None:
        """Wait for the response."""
        self.asked.call(Trigger.Request())


def test_a_callback_that_waits_for_a_response_gets_it_during_shutdown() -> None:
    rclpy.init()
    node, executor = Patient(), EventLoopExecutor(num_threads=4)
    executor.add_node(node)
    spin = Thread(target=executor.spin)
    spin.start()
    assert node.is_asked.wait(DEADLINE_S)
    stop = Thread(target=executor.shutdown)
    stop.start()
    eventually(lambda: executor._is_shutdown, "the stop is requested")
    node.may_answer.set()
    stop.join(DEADLINE_S)
    assert not stop.is_alive()
    spin.join()
    node.destroy_node()
    rclpy.shutdown()


@pytest.mark.usefixtures("chosen")
def test_a_node_survives_its_transitions() -> None:
    with spinning(Busy, lambda: _make_executor(MultiThreadedExecutor)) as node:
        for _ in range(ROUNDS):
            for transition in ("configure", "activate", "deactivate", "cleanup"):
                assert request(node, transition)


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_spinning_keeps_nothing_of_the_callbacks_that_ran(
    kind: Callable[[], Executor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OBK_EXECUTOR", "rclpy")
    rclpy.init()
    node, executor, over = rclpy.create_node("ticking"), _make_executor(kind), _End()
    kept: list[int] = []

    def tick() -> None:
        kept.append(len(over._callbacks))
        if len(kept) == 50:
            over.set_result(None)

    node.create_timer(0.001, tick)
    executor.add_node(node)
    executor.spin_until_future_complete(over, timeout_sec=DEADLINE_S)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    assert over.done()
    assert set(kept[:50]) == {1}
