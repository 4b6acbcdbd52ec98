"""The event-loop executor runs all entities of nodes, as users of rclpy expect."""

import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.guard_condition import GuardCondition
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.waitable import NumberOfEntities, Waitable
from std_msgs.msg import String

from .executor_world import DEADLINE_S, World, eventually, world

pytestmark = pytest.mark.ros

REENTRANT = ReentrantCallbackGroup()


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


def test_messages_arrive_in_order_and_with_their_info_if_requested(one: World) -> None:
    node = one.node()
    plain: list[str] = []
    with_info: list[tuple[str, int]] = []
    node.create_subscription(String, "topic", lambda m: plain.append(m.data), 100)
    node.create_subscription(
        String, "topic", lambda m, i: with_info.append((m.data, i["source_timestamp"])), 100
    )
    raw: list[bytes] = []
    node.create_subscription(String, "topic", raw.append, 100, raw=True)
    publisher = node.create_publisher(String, "topic", 100)
    for number in range(80):
        publisher.publish(String(data=str(number)))
    one.run_until(lambda: len(plain) == len(with_info) == len(raw) == 80, "80 messages")
    assert plain == [str(number) for number in range(80)]
    assert [text for text, _ in with_info] == plain
    assert all(stamp > 0 for _, stamp in with_info)
    assert b"79" in raw[-1]


def test_parameters_and_services_work_while_it_runs(one: World) -> None:
    server, asker = one.node("server"), one.node("asker")
    server.declare_parameter("gain", 1)
    set_gain = asker.create_client(SetParameters, "/server/set_parameters")
    get_gain = asker.create_client(GetParameters, "/server/get_parameters")
    answers: list[Any] = []

    async def ask() -> None:
        gain = Parameter("gain", value=7).to_parameter_msg()
        answers.append(await set_gain.call_async(SetParameters.Request(parameters=[gain])))
        answers.append(await get_gain.call_async(GetParameters.Request(names=["gain"])))

    assert set_gain.wait_for_service(DEADLINE_S)
    assert get_gain.wait_for_service(DEADLINE_S)
    one.executor.create_task(ask)
    one.run_until(lambda: len(answers) == 2, "both answers")
    assert answers[0].results[0].successful
    assert answers[1].values[0].integer_value == 7


def test_a_coroutine_service_may_wait_for_a_client_of_the_same_group(one: World) -> None:
    node = one.node()
    client = node.create_client(GetState, "inner")
    node.create_service(GetState, "inner", _label("inner"), callback_group=ReentrantCallbackGroup())

    async def outer(_request: Any, _response: Any) -> Any:
        return await client.call_async(GetState.Request())

    node.create_service(GetState, "outer", outer)
    asker = node.create_client(GetState, "outer")
    assert asker.wait_for_service(DEADLINE_S)
    assert client.wait_for_service(DEADLINE_S)
    future = asker.call_async(GetState.Request())
    one.executor.spin_until_future_complete(future, DEADLINE_S)
    assert future.result().current_state.label == "inner"


def test_an_exclusive_group_is_not_entered_while_its_coroutine_waits(one: World) -> None:
    node = one.node()
    group = MutuallyExclusiveCallbackGroup()
    gate: Future = Future()
    log: list[str] = []

    async def wait() -> None:
        log.append("begun")
        await gate
        log.append("over")
        slow.cancel()

    slow = node.create_timer(0.001, wait, callback_group=group)
    node.create_timer(0.001, lambda: log.append("same"), callback_group=group)
    free: list[int] = []
    node.create_timer(0.001, lambda: free.append(1))
    with one.spinning():
        eventually(lambda: "begun" in log, "the coroutine")
        count = len(free)
        eventually(lambda: len(free) > count + 10, "ticks of another group")
        held = list(log)
        gate.set_result(None)  # by a thread that reports to no executor
        eventually(lambda: "over" in log and log[-1] == "same", "ticks after the coroutine")
    assert held[-1] == "begun"
    assert held.count("begun") == 1


def test_guard_conditions_waitables_and_events_are_served(one: World) -> None:
    node = one.node()
    log: list[str | None] = []
    guard = node.create_guard_condition(lambda: log.append("guard"))
    waitable = _Waitable(node, log)
    node.add_waitable(waitable)
    callbacks = SubscriptionEventCallbacks(
        matched=lambda _info: log.append("matched"),
        incompatible_qos=lambda _info: log.append("incompatible"),
    )
    node.create_subscription(String, "t", lambda _message: None, 1, event_callbacks=callbacks)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_publisher(String, "t", 1)
    node.create_publisher(String, "t", best_effort)
    with one.spinning():
        eventually(lambda: {"matched", "incompatible"} <= set(log), "both events")
        for number in range(1, 6):
            guard.trigger()
            eventually(lambda n=number: log.count("guard") == n, "the guard condition")
        for number in range(1, 6):
            waitable.trigger()
            eventually(lambda n=number: log.count("data") == n, "the waitable")
        assert log.count("matched") == 1
        assert None not in log


def test_tasks_may_be_created_on_any_thread_and_their_result_is_a_future(one: World) -> None:
    one.node()
    tasks: list[Any] = []

    async def double(number: int) -> int:
        return number * 2

    def create() -> None:
        for number in range(100):
            tasks.append(one.executor.create_task(double, number))
            tasks.append(one.executor.create_task(lambda n=number: n * 2))

    threads = [threading.Thread(target=create) for _ in range(4)]
    with one.spinning():
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        eventually(lambda: all(task.done() for task in tasks), "800 tasks")
    assert sum(task.result() for task in tasks) == 8 * sum(n * 2 for n in range(100))


def test_zero_threads_are_rejected() -> None:
    with (
        world() as made,
        pytest.raises(ValueError, match="num_threads is 0"),
    ):
        type(made.executor)(0, context=made.context)


def test_exclusive_groups_never_overlap_and_reentrant_ones_do() -> None:
    with world(num_threads=3) as made:
        node = made.node()
        lock = threading.Lock()
        groups = {
            "exclusive": MutuallyExclusiveCallbackGroup(),
            "reentrant": ReentrantCallbackGroup(),
        }
        running = dict.fromkeys(groups, 0)
        most = dict.fromkeys(groups, 0)

        def tick(name: str) -> None:
            with lock:
                running[name] += 1
                most[name] = max(most[name], running[name])
            time.sleep(0.003)
            with lock:
                running[name] -= 1

        for name, group in groups.items():
            for _ in range(3):
                node.create_timer(0.004, lambda n=name: tick(n), callback_group=group)
        made.run_until(
            lambda: most["reentrant"] > 1 and most["exclusive"],
            "callbacks of both, reentrant ones at the same time",
        )
    assert most["exclusive"] == 1


def test_with_more_threads_a_callback_may_wait_for_an_answer() -> None:
    with world(num_threads=2) as made:
        node = made.node()
        group = ReentrantCallbackGroup()
        node.create_service(GetState, "state", _label("here"), callback_group=group)
        client = node.create_client(GetState, "state", callback_group=group)
        answers: list[str] = []

        def ask() -> None:
            with suppress(TimeoutError):  # the first response to a client may get lost
                answer = client.call(GetState.Request(), timeout_sec=2.0)
                answers.append(answer.current_state.label)

        node.create_timer(0.01, ask, callback_group=MutuallyExclusiveCallbackGroup())
        ticks: list[int] = []
        node.create_timer(0.001, lambda: ticks.append(1))
        made.run_until(lambda: len(answers) >= 3 and len(ticks) > 3, "answers to blocking calls")
    assert set(answers) == {"here"}


def _label(label: str) -> Any:
    def answer(_request: Any, response: Any) -> Any:
        response.current_state.label = label
        return response

    return answer


class _Waitable(Waitable):
    """Has data after `trigger`, and keeps a wait set awake until the data is taken."""

    def __init__(self, node: Any, log: list[str | None]) -> None:
        super().__init__(node.default_callback_group)
        self._guard = GuardCondition(None, None, context=node.context)
        self._has_data = False
        self._log = log

    def trigger(self) -> None:
        self._has_data = True
        self._guard.trigger()

    def __enter__(self) -> None:
        self._guard.handle.__enter__()

    def __exit__(self, *exception: Any) -> None:
        self._guard.handle.__exit__(*exception)

    def is_ready(self, wait_set: Any) -> bool:
        if self._has_data:
            self._guard.trigger()
        return self._has_data

    def take_data(self) -> str | None:
        had_data, self._has_data = self._has_data, False
        return "data" if had_data else None

    async def execute(self, taken_data: str | None) -> None:
        self._log.append(taken_data)

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_gcs=1)

    def add_to_wait_set(self, wait_set: Any) -> None:
        wait_set.add_guard_condition(self._guard.handle)


def test_a_reentrant_callback_waits_for_an_exclusive_group_without_delaying_it() -> None:
    with world(num_threads=2) as made:
        server, node = made.node("server"), made.node()
        server.create_service(
            GetState, "state", lambda _, response: response, callback_group=REENTRANT
        )
        client = node.create_client(GetState, "state")  # in the node's exclusive group
        beats: list[float] = []
        node.create_timer(0.01, lambda: beats.append(time.monotonic()))
        answers: list[Any] = []

        def ask() -> None:
            timer.cancel()
            before = len(beats)
            eventually(lambda: len(beats) > before + 5, "ticks during a reentrant callback")
            while not answers:
                with suppress(TimeoutError):  # the first response to a client may get lost
                    answers.append(client.call(GetState.Request(), timeout_sec=2.0))

        timer = node.create_timer(0.01, ask, callback_group=REENTRANT)
        assert client.wait_for_service(DEADLINE_S)
        made.run_until(lambda: answers, "the response")
    assert answers[0] is not None
