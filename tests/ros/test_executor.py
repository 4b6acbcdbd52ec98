"""The event-loop executor runs what nodes have, in the manner that users of rclpy rely on."""

import itertools
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rclpy.waitable import NumberOfEntities, Waitable
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import String

from .executor_world import World, eventually, world

pytestmark = pytest.mark.ros

S_IN_NS = 10**9


@pytest.fixture
def one() -> Iterator[World]:
    with world() as made:
        yield made


def test_messages_arrive_in_order_and_with_their_info_where_asked_for(one: World) -> None:
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


@pytest.mark.parametrize("clock_type", [ClockType.STEADY_TIME, ClockType.SYSTEM_TIME])
def test_a_timer_is_never_early_and_rests_while_it_is_cancelled(
    one: World, clock_type: ClockType
) -> None:
    node = one.node()
    clock = Clock(clock_type=clock_type)
    ticks: list[int] = []
    start_ns = clock.now().nanoseconds
    timer = node.create_timer(0.01, lambda: ticks.append(clock.now().nanoseconds), clock=clock)
    with one.spinning():
        eventually(lambda: len(ticks) >= 10, "ten ticks")
        timer.cancel()
        time.sleep(0.02)
        count = len(ticks)
        time.sleep(0.05)
        assert len(ticks) == count
        timer.reset()
        eventually(lambda: len(ticks) > count, "a tick after reset")
    assert all(at >= start_ns + (n + 1) * 10_000_000 for n, at in enumerate(ticks[:10]))


def test_a_timer_that_is_not_started_waits_for_its_reset(one: World) -> None:
    node = one.node()
    ticks: list[int] = []
    timer = node.create_timer(0.005, lambda: ticks.append(1), autostart=False)
    with one.spinning():
        time.sleep(0.05)
        assert not ticks
        timer.reset()
        eventually(lambda: len(ticks) >= 3, "ticks after reset")


def test_a_timer_takes_a_new_period_and_may_cancel_and_reset_itself(one: World) -> None:
    node = one.node()
    ticks: list[int] = []

    def tick() -> None:
        ticks.append(1)
        if len(ticks) == 1:
            timer.timer_period_ns = 1_000_000
        if len(ticks) == 20:
            timer.cancel()
            timer.reset()
        if len(ticks) == 40:
            timer.cancel()

    # So slow that without the new period it would not come to its 20th tick in time.
    timer = node.create_timer(1.2, tick)
    with one.spinning():
        eventually(lambda: len(ticks) == 40, "40 ticks of a timer that became faster")
        time.sleep(0.02)
    assert len(ticks) == 40


def test_a_timer_that_was_late_skips_periods_instead_of_catching_up(one: World) -> None:
    node = one.node()
    ticks: list[float] = []

    def tick() -> None:
        ticks.append(time.monotonic())
        if len(ticks) == 3:
            time.sleep(0.3)

    node.create_timer(0.02, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
    start = time.monotonic()
    one.run_until(lambda: len(ticks) >= 10, "ten ticks")
    assert len(ticks) <= (time.monotonic() - start - 0.28) / 0.02 + 2


def test_simulated_time_drives_timers(one: World) -> None:
    node = one.node(parameter_overrides=[Parameter("use_sim_time", value=True)])
    clock_source = one.node("clock")
    ticks: list[int] = []
    node.create_timer(1.0, lambda: ticks.append(node.get_clock().now().nanoseconds))
    publisher = clock_source.create_publisher(ClockMessage, "/clock", 10)
    now_ns = [0]

    def advance() -> None:
        now_ns[0] += S_IN_NS // 4
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = divmod(now_ns[0], S_IN_NS)
        publisher.publish(message)

    clock_source.create_timer(0.002, advance, clock=Clock(clock_type=ClockType.STEADY_TIME))
    one.run_until(lambda: len(ticks) >= 8, "eight simulated seconds")
    steps = [later - earlier for earlier, later in itertools.pairwise(ticks[1:])]
    assert min(steps) >= S_IN_NS // 2
    assert ticks[-1] <= now_ns[0]


def test_a_flood_of_messages_does_not_stop_timers(one: World) -> None:
    node = one.node()
    received, ticks = [0], [0]
    publisher = node.create_publisher(String, "flood", 10)

    def again(_message: String) -> None:
        received[0] += 1
        publisher.publish(String())
        publisher.publish(String())

    node.create_subscription(String, "flood", again, 10)
    node.create_timer(0.002, lambda: ticks.__setitem__(0, ticks[0] + 1))
    publisher.publish(String())
    one.run_until(lambda: received[0] > 500 and ticks[0] > 20, "ticks during the flood")


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

    assert set_gain.wait_for_service(10)
    assert get_gain.wait_for_service(10)
    one.executor.create_task(ask)
    one.run_until(lambda: len(answers) == 2, "both answers")
    assert answers[0].results[0].successful
    assert answers[1].values[0].integer_value == 7


def test_a_coroutine_service_may_wait_for_a_client_of_its_own_group(one: World) -> None:
    node = one.node()
    client = node.create_client(GetState, "inner")
    node.create_service(GetState, "inner", _label("inner"), callback_group=ReentrantCallbackGroup())

    async def outer(_request: Any, _response: Any) -> Any:
        return await client.call_async(GetState.Request())

    node.create_service(GetState, "outer", outer)
    asker = node.create_client(GetState, "outer")
    assert asker.wait_for_service(10)
    assert client.wait_for_service(10)
    future = asker.call_async(GetState.Request())
    one.executor.spin_until_future_complete(future, 10)
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
        gate.set_result(None)  # by a thread that tells nobody
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


def test_tasks_come_from_any_thread_and_their_result_is_a_future(one: World) -> None:
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


def test_what_a_callback_raises_comes_out_of_spin_which_can_go_on(one: World) -> None:
    node = one.node()
    received: list[str] = []

    def receive(message: String) -> None:
        received.append(message.data)
        if message.data == "0":
            raise ValueError("boom")

    node.create_subscription(String, "topic", receive, 10)
    publisher = node.create_publisher(String, "topic", 10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    with pytest.raises(ValueError, match="boom"):
        one.executor.spin()
    one.run_until(lambda: received == ["0", "1", "2"], "the messages after the one that failed")


@pytest.mark.parametrize("kind", ["timer", "task", "coroutine", "guard", "service"])
def test_exceptions_come_out_whatever_raised_them(one: World, kind: str) -> None:
    node = one.node()

    def fail(*_args: object) -> None:
        raise ValueError("boom")

    async def fail_later() -> None:
        await future
        raise ValueError("boom")

    future: Future = Future()
    if kind == "timer":
        node.create_timer(0.001, fail)
    elif kind == "task":
        one.executor.create_task(fail)
    elif kind == "coroutine":
        one.executor.create_task(fail_later)
        threading.Timer(0.02, lambda: future.set_result(None)).start()
    elif kind == "guard":
        node.create_guard_condition(fail).trigger()
    else:
        node.create_service(GetState, "state", fail)
        client = node.create_client(GetState, "state")
        assert client.wait_for_service(10)
        client.call_async(GetState.Request())
    with pytest.raises(ValueError, match="boom"):
        one.executor.spin()


def test_spin_once_runs_one_callback(one: World) -> None:
    node = one.node()
    received: list[str] = []
    node.create_subscription(String, "topic", lambda m: received.append(m.data), 10)
    publisher = node.create_publisher(String, "topic", 10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    counts = [0]
    end = time.monotonic() + 10
    while len(received) < 3 and time.monotonic() < end:
        one.executor.spin_once(timeout_sec=0.5)
        counts.append(len(received))
    assert received == ["0", "1", "2"]
    assert {later - earlier for earlier, later in itertools.pairwise(counts)} <= {0, 1}


def test_waits_end_at_their_timeout(one: World) -> None:
    one.node()
    start = time.monotonic()
    one.executor.spin_once(timeout_sec=0)
    one.executor.spin_once(timeout_sec=0.05)
    one.executor.spin_until_future_complete(Future(), timeout_sec=0.05)
    one.executor.spin_once_until_future_complete(Future(), timeout_sec=0.05)
    assert time.monotonic() - start >= 0.15


def test_waiting_for_a_future_ends_with_it_and_leaves_nothing_on_it(one: World) -> None:
    one.node()
    never: Future = Future()
    for _ in range(3):
        one.executor.spin_until_future_complete(never, timeout_sec=0)
    assert never._callbacks == []
    for end in (lambda future: future.set_result(1), Future.cancel):
        future: Future = Future()
        timer = threading.Timer(0.02, end, [future])
        timer.start()
        one.executor.spin_until_future_complete(future, timeout_sec=3e8)
        timer.join()
        assert future.done() or future.cancelled()


def test_a_second_spin_of_the_same_executor_is_refused(one: World) -> None:
    node = one.node()
    refused: list[str] = []

    def nested() -> None:
        try:
            one.executor.spin_once(0)
        except RuntimeError as error:
            refused.append(str(error))

    node.create_timer(0.001, nested)
    one.run_until(lambda: refused, "the refusal")
    assert refused[0] == "this executor is spinning already"


def test_the_end_of_the_context_ends_spin(one: World) -> None:
    one.node()
    timer = threading.Timer(0.05, one.context.shutdown)
    timer.start()
    one.executor.spin()
    timer.join()
    with pytest.raises(ExternalShutdownException):
        one.executor.spin_once()


def test_shutdown_within_a_callback_ends_spin(one: World) -> None:
    node = one.node()
    node.create_timer(0.001, one.executor.shutdown)
    one.executor.spin()
    assert one.executor.get_nodes() == []
    one.executor.spin()  # returns at once
    one.executor.wake()
    assert one.executor.shutdown()


def test_shutdown_tells_of_a_callback_that_takes_too_long(one: World) -> None:
    node = one.node()
    entered, leave = threading.Event(), threading.Event()
    node.create_timer(0.001, lambda: (entered.set(), leave.wait()))
    thread = threading.Thread(target=one.executor.spin)
    thread.start()
    assert entered.wait(10)
    assert not one.executor.shutdown(timeout_sec=0.05)
    leave.set()
    thread.join()
    assert one.executor.shutdown(timeout_sec=5)


def test_no_thread_at_all_is_refused() -> None:
    with (
        world() as made,
        pytest.raises(ValueError, match=r"^num_threads is 0, expected at least 1$"),
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
        made.run_until(lambda: most["reentrant"] > 1, "reentrant callbacks at the same time")
    assert most["exclusive"] == 1


def test_with_more_threads_a_callback_may_wait_for_an_answer() -> None:
    with world(num_threads=2) as made:
        node = made.node()
        group = ReentrantCallbackGroup()
        node.create_service(GetState, "state", _label("here"), callback_group=group)
        client = node.create_client(GetState, "state", callback_group=group)
        answers: list[str] = []
        node.create_timer(
            0.01,
            lambda: answers.append(client.call(GetState.Request()).current_state.label),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        ticks: list[int] = []
        node.create_timer(0.001, lambda: ticks.append(1))
        made.run_until(lambda: len(answers) >= 3 and len(ticks) > 3, "answers to blocking calls")
    assert set(answers) == {"here"}


def test_an_exception_on_another_thread_comes_out_of_spin() -> None:
    with world(num_threads=2) as made:
        node = made.node()

        def fail() -> None:
            raise ValueError("boom")

        node.create_timer(0.01, lambda: None)
        node.create_timer(0.001, fail, callback_group=MutuallyExclusiveCallbackGroup())
        with pytest.raises(ValueError, match="boom"):
            made.executor.spin()


def _label(label: str) -> Any:
    def answer(_request: Any, response: Any) -> Any:
        response.current_state.label = label
        return response

    return answer


class _Waitable(Waitable):
    """Has data after `trigger`, and keeps a wait set awake until they are taken."""

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
