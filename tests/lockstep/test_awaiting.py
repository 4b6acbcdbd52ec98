"""Services, parameters, futures and `await` in lockstep."""

from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from obelisk_py.core.lockstep.scheduler import LockstepError, TimingModel

from .world import World, seconds

pytestmark = pytest.mark.ros


def _serve(node: Any, name: str = "/hello") -> Any:
    def answer(_request: Any, response: Any) -> Any:
        response.success, response.message = True, f"at {seconds(node):g}"
        return response

    return node.create_service(Trigger, name, answer)


def test_a_call_gets_its_response_after_the_latency_of_both_directions(
    make_world: Callable[..., World],
) -> None:
    world = make_world(timing=TimingModel(latency=0.002))
    server, caller = world.node("server", compute_s=0.01), world.node("caller")
    _serve(server)
    client = caller.create_client(Trigger, "/hello")
    seen: list[tuple[float, str]] = []

    def call() -> None:
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda f: seen.append((seconds(caller), f.result().message)))

    world.at(caller, 0.1, call)
    world.run(0.2)
    assert seen == [(0.114, "at 0.102")]


def test_a_node_calls_its_own_service(world: World) -> None:
    node = world.node()
    _serve(node, "~/hello")
    client = node.create_client(Trigger, "~/hello")
    seen: list[str] = []

    async def tick() -> None:
        seen.append((await client.call_async(Trigger.Request())).message)

    world.at(node, 0.1, tick)
    world.run(0.1)
    assert seen == ["at 0.1"]


def test_await_works_in_every_kind_of_callback(world: World) -> None:
    server, node = world.node("server"), world.node()
    _serve(server)
    client = node.create_client(Trigger, "/hello")
    seen: list[str] = []

    async def inner() -> str:
        return str((await client.call_async(Trigger.Request())).message)

    async def nested(what: str) -> str:
        seen.append(f"{what} {await inner()} {await inner()}")
        return what

    async def timer() -> None:
        await nested("timer")

    async def subscription(message: String) -> None:
        await nested(message.data)

    async def service(_request: Any, response: Any) -> Any:
        response.message = await nested("service")
        return response

    async def guard() -> None:
        await nested("guard")

    node.create_subscription(String, "/text", subscription, 10)
    node.create_service(Trigger, "/asynchronous", service)
    publisher = server.create_publisher(String, "/text", 10)
    condition = node.create_guard_condition(guard)
    asynchronous = server.create_client(Trigger, "/asynchronous")
    world.at(node, 0.1, timer)
    world.at(server, 0.2, lambda: publisher.publish(String(data="subscription")))
    answers: list[str] = []

    def call() -> None:
        future = asynchronous.call_async(Trigger.Request())
        future.add_done_callback(lambda f: answers.append(f.result().message))

    world.at(server, 0.3, call)
    world.at(node, 0.4, condition.trigger)
    world.at(node, 0.5, lambda: node.executor.create_task(nested("task")))
    world.run(0.6)
    assert seen == [
        "timer at 0.1 at 0.1",
        "subscription at 0.2 at 0.2",
        "service at 0.3 at 0.3",
        "guard at 0.4 at 0.4",
        "task at 0.5 at 0.5",
    ]
    assert answers == ["service"]


@pytest.mark.parametrize("has_executor", [True, False])
def test_a_future_of_the_user_is_awaited(world: World, has_executor: bool) -> None:
    node = world.node()
    future = Future(executor=node.executor if has_executor else None)
    seen: list[Any] = []

    async def wait() -> None:
        seen.append((await future, seconds(node)))

    world.at(node, 0.1, wait)
    world.at(node, 0.25, lambda: future.set_result("done"))
    world.run(0.3)
    assert seen == [("done", 0.25)]


def test_a_task_is_awaited_and_its_exception_is_raised(world: World) -> None:
    node = world.node()
    seen: list[Any] = []

    async def work(number: int) -> int:
        if number < 0:
            raise ValueError("negative")
        return 2 * number

    async def wait() -> None:
        seen.append(await node.executor.create_task(work, 4))
        task = node.executor.create_task(lambda: 5)
        seen.append(await task)

    world.at(node, 0.1, wait)
    world.run(0.2)
    assert seen == [8, 5]
    world.at(node, 0.3, lambda: node.executor.create_task(work(-1)))
    world.run(0.2)
    assert node.state_label == "unconfigured"
    assert "ValueError: negative" in str(node.last_fault)


def test_an_awaitable_that_only_yields_is_polled_each_millisecond(world: World) -> None:
    node = world.node()
    seen: list[float] = []

    class Pause:
        def __await__(self) -> Any:
            yield
            yield

    async def wait() -> None:
        await Pause()
        seen.append(seconds(node))

    world.at(node, 0.1, wait)
    world.run(0.2)
    assert seen == [0.102]


def test_a_canceled_future_ends_the_wait(world: World) -> None:
    node = world.node()
    future = Future()
    seen: list[Any] = []

    async def wait() -> None:
        seen.append(await future)

    world.at(node, 0.1, wait)
    world.at(node, 0.2, future.cancel)
    world.run(0.3)
    assert seen == [None]
    assert node.last_fault is None


def test_a_killed_server_never_responds_and_is_no_error(world: World) -> None:
    server, node = world.node("server"), world.node()
    _serve(server)
    client = node.create_client(Trigger, "/hello")
    futures: list[Any] = []
    world.lockstep.kill(world.lockstep.nodes["/server"])
    world.at(node, 0.1, lambda: futures.append(client.call_async(Trigger.Request())))
    world.run(0.2)
    assert not futures[0].done()
    assert not client.service_is_ready()
    assert any("/hello" in note for note in world.notes)


def test_a_destroyed_service_does_not_answer(make_world: Callable[..., World]) -> None:
    world = make_world(timing=TimingModel(latency=0.01))
    server, node = world.node("server"), world.node()
    service = _serve(server)
    client = node.create_client(Trigger, "/hello")
    futures: list[Any] = []
    world.at(node, 0.1, lambda: futures.append(client.call_async(Trigger.Request())))
    world.at(server, 0.105, lambda: server.destroy_service(service))
    world.run(0.2)
    assert not futures[0].done()


def test_a_destroyed_client_gets_no_response(make_world: Callable[..., World]) -> None:
    world = make_world(timing=TimingModel(latency=0.01))
    server, node = world.node("server"), world.node()
    _serve(server)
    client = node.create_client(Trigger, "/hello")
    futures: list[Any] = []
    world.at(node, 0.1, lambda: futures.append(client.call_async(Trigger.Request())))
    world.at(node, 0.105, lambda: node.destroy_client(client))
    world.run(0.2)
    assert not futures[0].done()


def test_a_blocking_call_ends_the_run_with_its_location(world: World) -> None:
    server, node = world.node("server"), world.node()
    _serve(server)
    client = node.create_client(Trigger, "/hello")
    world.at(node, 0.1, lambda: client.call(Trigger.Request()))
    with pytest.raises(LockstepError, match=r"/node waits .* /hello \(.*test_awaiting\.py:\d+\)"):
        world.run(0.2)


def test_waiting_for_a_service_takes_the_timeout(world: World) -> None:
    node = world.node()
    client = node.create_client(Trigger, "/missing")
    seen: list[Any] = []

    def wait() -> None:
        seen.append(client.wait_for_service(timeout_sec=0.5))
        seen.append(seconds(node))

    world.at(node, 0.1, wait)
    world.run(0.2)
    assert seen == [False, 0.6]


def test_waiting_for_a_service_without_end_ends_the_run(world: World) -> None:
    node = world.node()
    client = node.create_client(Trigger, "/missing")

    def wait_for_ever() -> None:
        while not client.wait_for_service(timeout_sec=1.0):
            pass

    world.at(node, 0.1, wait_for_ever)
    with pytest.raises(LockstepError, match=r"test_awaiting\.py:\d+: it is waiting for"):
        world.run(0.2)
    other = world.node("other")
    client = other.create_client(Trigger, "/missing")
    world.at(other, 0.3, client.wait_for_service)
    with pytest.raises(LockstepError, match=r"/missing \(.*\), which no node serves"):
        world.run(0.2)


@pytest.mark.parametrize("own_executor", [True, False])
def test_spinning_in_a_callback_ends_the_run(world: World, own_executor: bool) -> None:
    node = world.node()

    def spin() -> None:
        executor = SingleThreadedExecutor() if own_executor else None
        rclpy.spin_until_future_complete(node, Future(), executor=executor)

    world.at(node, 0.1, spin)
    with pytest.raises(LockstepError, match=r"spins an executor in a callback \(.*awaiting.py"):
        world.run(0.2)


def test_parameters_are_set_and_read_through_their_services(world: World) -> None:
    node, other = world.node(), world.node("other")
    node.declare_parameter("gain", 1.0)
    client = AsyncParameterClient(other, "/node")
    seen: list[Any] = []

    async def change() -> None:
        answer = await client.set_parameters([Parameter("gain", value=2.5)])
        seen.append(answer.results[0].successful)
        answer = await client.set_parameters([Parameter("gain", value="text")])
        seen.append(answer.results[0].successful)
        seen.append((await client.get_parameters(["gain"])).values[0].double_value)

    world.at(other, 0.1, change)
    world.run(0.2)
    assert seen == [True, False, 2.5]


def test_a_test_calls_a_service(world: World) -> None:
    node = world.node()
    node.declare_parameter("gain", 1.0)
    answers: list[Any] = []
    request = GetParameters.Request(names=["gain"])
    with world.lockstep.entered():
        world.lockstep.services.call("/node/get_parameters", request, None, answers.append)
    world.run(0.0)
    assert answers[0].values[0].double_value == 1.0
