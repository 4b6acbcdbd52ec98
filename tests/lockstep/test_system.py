"""System calls in lockstep: time, dates, sleep, random numbers, threads and logs."""

import asyncio
import calendar
import copy
import datetime
import functools
import inspect
import multiprocessing
import os
import pickle
import queue
import random
import sched
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
import yaml
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep import callback_limit, guest_thread
from obelisk_py.core.lockstep.scheduler import LockstepError

from .world import World, seconds

pytestmark = pytest.mark.ros


def _in_callback(world: World, read: Callable[[], Any], t: float = 1.5) -> Any:
    """The result of `read` in a callback at a time."""
    node = world.node()
    seen: list[Any] = []
    world.at(node, t, lambda: seen.append(read()))
    world.run(t)
    assert node.last_fault is None, node.last_fault
    return seen[0]


READS: dict[str, Callable[[], float]] = {
    "time": lambda: time.time(),
    "monotonic": lambda: time.monotonic(),
    "perf_counter": lambda: time.perf_counter(),
    "time_ns": lambda: time.time_ns() / 1e9,
    "monotonic_ns": lambda: time.monotonic_ns() / 1e9,
    "perf_counter_ns": lambda: time.perf_counter_ns() / 1e9,
    "clock_gettime": lambda: time.clock_gettime(time.CLOCK_MONOTONIC),
    "datetime.now": lambda: datetime.datetime.now().timestamp(),
    "datetime.now(UTC)": lambda: datetime.datetime.now(datetime.UTC).timestamp(),
    "datetime.today": lambda: datetime.datetime.today().timestamp(),
    "gmtime": lambda: calendar.timegm(time.gmtime()) + 0.5,
    "strftime": lambda: float(time.strftime("%s")) + 0.5,
    "system clock": lambda: Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds / 1e9,
    "steady clock": lambda: Clock(clock_type=ClockType.STEADY_TIME).now().nanoseconds / 1e9,
    "ROS clock": lambda: Clock(clock_type=ClockType.ROS_TIME).now().nanoseconds / 1e9,
}


@pytest.mark.parametrize("name", READS)
def test_every_clock_is_simulated_in_callbacks_and_only_there(world: World, name: str) -> None:
    before = READS[name]()
    assert _in_callback(world, READS[name]) == 1.5
    assert READS[name]() >= before > 1.5


def test_the_day_is_that_of_simulated_time(world: World) -> None:
    assert _in_callback(world, datetime.date.today) == datetime.date.fromtimestamp(1.5)


def test_dates_of_the_system_are_dates(world: World) -> None:
    now = _in_callback(world, lambda: datetime.datetime.now(datetime.UTC))
    assert isinstance(now, datetime.datetime)
    assert isinstance(datetime.datetime.fromtimestamp(0), datetime.date)
    assert now - datetime.datetime.fromtimestamp(0, datetime.UTC) == datetime.timedelta(seconds=1.5)


@pytest.mark.parametrize(
    "make",
    [
        lambda: datetime.datetime(2026, 1, 2, 3, 4, 5, tzinfo=datetime.UTC),
        lambda: datetime.datetime.now(datetime.UTC),
        lambda: datetime.datetime.fromtimestamp(1.5) + datetime.timedelta(1),
        lambda: datetime.datetime(2026, 1, 2, fold=1),
    ],
)
def test_dates_can_be_saved(world: World, make: Callable[[], datetime.datetime]) -> None:
    date = _in_callback(world, make)
    assert isinstance(date, datetime.datetime)
    assert pickle.loads(pickle.dumps(date)) == date
    assert copy.deepcopy(date) == date
    assert yaml.safe_load(yaml.safe_dump({"at": date})) == {"at": date}


def test_a_class_of_dates_keeps_its_objects(world: World) -> None:
    class Deadline(datetime.datetime):
        pass

    assert type(_in_callback(world, lambda: Deadline(2026, 1, 2))) is Deadline


def _wait_for_a_job(timeout_s: float) -> None:
    with pytest.raises(queue.Empty):
        queue.Queue[int]().get(timeout=timeout_s)


def _wait_for_a_condition(timeout_s: float) -> None:
    condition = threading.Condition()
    with condition:
        assert not condition.wait_for(lambda: False, timeout_s)


def _wait_at_a_barrier(timeout_s: float) -> None:
    with pytest.raises(threading.BrokenBarrierError):
        threading.Barrier(2).wait(timeout_s)


def _run_scheduler(delay_s: float) -> None:
    scheduler = sched.scheduler()
    scheduler.enter(delay_s, 1, lambda: None)
    scheduler.run()


SLEEPS: dict[str, Callable[[Any], object]] = {
    "time.sleep": lambda _: time.sleep(0.03),
    "Rate.sleep": lambda node: node.create_rate(1 / 0.03).sleep(),
    "sleep_for": lambda node: node.get_clock().sleep_for(Duration(seconds=0.03)),
    "own clock": lambda _: Clock(clock_type=ClockType.STEADY_TIME).sleep_for(
        Duration(seconds=0.03)
    ),
    "asyncio": lambda _: asyncio.run(asyncio.sleep(0.03)),
    "event": lambda _: threading.Event().wait(0.03),
    "queue": lambda _: _wait_for_a_job(0.03),
    "condition": lambda _: _wait_for_a_condition(0.03),
    "semaphore": lambda _: threading.Semaphore(0).acquire(timeout=0.03),
    "barrier": lambda _: _wait_at_a_barrier(0.03),
    "scheduler": lambda _: _run_scheduler(0.03),
}


@pytest.mark.parametrize("name", SLEEPS)
def test_sleep_makes_only_its_node_late_and_is_noted_once(world: World, name: str) -> None:
    sleeper, other = world.node("sleeper"), world.node("other")
    times: dict[str, list[float]] = {"sleeper": [], "other": [], "after": []}

    def tick() -> None:
        times["sleeper"].append(seconds(sleeper))
        SLEEPS[name](sleeper)
        times["after"].append(seconds(sleeper))

    sleeper.create_timer(0.02, tick)
    other.create_timer(0.02, lambda: times["other"].append(seconds(other)))
    begin = time.monotonic()
    world.run(0.1)
    assert times == {
        "sleeper": [0.02, 0.05, 0.08],
        "after": [0.05, 0.08, 0.11],
        "other": [0.02, 0.04, 0.06, 0.08, 0.1],
    }
    assert time.monotonic() - begin < 60.0
    (note,) = world.notes
    assert "/sleeper" in note
    assert "test_system.py:" in note


def test_a_callback_that_polls_without_end_is_an_error(world: World) -> None:
    node = world.node()

    def poll() -> None:
        while True:
            time.sleep(0.1)

    world.at(node, 0.1, poll)
    with pytest.raises(LockstepError, match=r"/node has slept for 1,000 s .*test_system\.py:\d+"):
        world.run(0.2)


def test_only_the_first_error_of_a_callback_ends_the_run(world: World) -> None:
    node = world.node()

    def ignore_errors() -> None:
        for _ in range(3):
            with suppress(LockstepError):
                time.sleep(2_000)
        ignored.append(True)

    ignored: list[bool] = []
    world.at(node, 0.1, ignore_errors)
    with pytest.raises(LockstepError, match="/node has slept for 2,000 s"):
        world.run(0.2)
    assert ignored


def test_an_event_that_no_callback_can_set_is_an_error(world: World) -> None:
    node = world.node()
    world.at(node, 0.1, lambda: threading.Event().wait())
    with pytest.raises(LockstepError, match=r"/node waits .*test_system\.py:\d+.*deadlock"):
        world.run(0.2)


CHANCES: dict[str, Callable[[], Any]] = {
    "default_rng": lambda: np.random.default_rng().random(),
    "RandomState": lambda: np.random.RandomState().random_sample(),
    "np.random": lambda: np.random.random(),
    "random": lambda: random.random(),
    "Random()": lambda: random.Random().random(),
    "SystemRandom": lambda: random.SystemRandom().random(),
    "seed()": lambda: (random.seed(), random.random())[1],
    "np.random.seed()": lambda: (np.random.seed(), np.random.random())[1],
    "uuid4": lambda: uuid.uuid4().hex,
    "getrandom": lambda: os.getrandom(8),
}


@pytest.mark.parametrize("name", CHANCES)
def test_chance_without_a_seed_has_that_of_the_run(
    make_world: Callable[..., World], name: str
) -> None:
    def draw(seed: int) -> Any:
        return _in_callback(make_world(seed=seed), CHANCES[name])

    first = draw(1)
    random.random()
    np.random.random()
    assert draw(1) == first
    assert draw(2) != first
    assert CHANCES[name]() != first


def test_draws_outside_of_the_run_change_nothing(make_world: Callable[..., World]) -> None:
    def draws(between: Callable[[], object]) -> list[float]:
        world = make_world(seed=3)
        node = world.node()
        seen: list[float] = []
        node.create_timer(0.1, lambda: seen.extend((random.random(), np.random.random())))
        for _ in range(3):
            world.run(0.1)
            between()
        return seen

    random.seed(5)
    own = random.random()
    assert draws(lambda: None) == draws(lambda: (random.random(), np.random.random()))
    random.seed(5)
    draws(lambda: None)
    assert random.random() == own


@pytest.mark.parametrize("name", ["condition", "semaphore", "barrier", "scheduler"])
def test_a_thread_waits_until_a_timeout_in_simulated_time(world: World, name: str) -> None:
    node = world.node()
    ended: list[float] = []

    def wait() -> None:
        SLEEPS[name](node)
        ended.append(seconds(node))

    world.at(node, 0.1, threading.Thread(target=wait).start)
    world.run(0.2)
    assert ended == pytest.approx([0.13], abs=1e-8)
    assert not world.notes


def test_a_timer_of_the_threading_module_is_on_simulated_time(world: World) -> None:
    node = world.node()
    fired: list[float] = []
    timer = threading.Timer(0.03, lambda: fired.append(seconds(node)))
    canceled = threading.Timer(0.03, lambda: fired.append(seconds(node)))
    world.at(node, 0.1, lambda: (timer.start(), canceled.start()))
    world.at(node, 0.12, canceled.cancel)
    world.run(0.2)
    assert fired == pytest.approx([0.13], abs=1e-8)


@pytest.mark.parametrize("module", [queue, sched, threading], ids=lambda module: module.__name__)
def test_no_module_with_timeouts_keeps_the_time_of_the_system(module: Any) -> None:
    of_system = [
        name
        for name, value in vars(module).items()
        if inspect.isbuiltin(value) and value.__module__ == "time"
    ]
    assert not of_system


def test_a_condition_times_out_beside_a_thread_outside_lockstep(world: World) -> None:
    node = world.node()
    ours, its = socket.socketpair()
    thread = threading.Thread(target=lambda: its.recv(1))
    ended: list[float] = []

    def wait() -> None:
        _wait_for_a_condition(0.03)
        ended.append(seconds(node))

    with ours, its:
        world.at(node, 0.1, thread.start)
        world.at(node, 0.2, wait)
        world.run(0.3)
        ours.send(b"1")
        thread.join(5.0)
    assert ended == pytest.approx([0.23], abs=1e-8)


def test_a_thread_takes_turns_with_the_callbacks(world: World) -> None:
    node = world.node()
    seen: list[tuple[str, float]] = []

    def loop() -> None:
        while True:
            seen.append(("thread", time.time()))
            time.sleep(0.02)

    world.at(node, 0.01, threading.Thread(target=loop).start)
    node.create_timer(0.02, lambda: seen.append(("timer", time.time())))
    world.run(0.06)
    assert seen == [
        ("thread", 0.01),
        ("timer", 0.02),
        ("thread", 0.03),
        ("timer", 0.04),
        ("thread", 0.05),
        ("timer", 0.06),
    ]
    assert not world.notes


def test_a_callback_waits_for_its_thread_in_simulated_time(world: World) -> None:
    node = world.node()
    seen: list[tuple[bool, float]] = []

    def tick() -> None:
        is_done = threading.Event()
        thread = threading.Thread(target=lambda: (time.sleep(0.03), is_done.set()))
        thread.start()
        seen.append((is_done.wait(0.01), seconds(node)))
        seen.append((is_done.wait(), seconds(node)))
        thread.join()
        assert not thread.is_alive()

    world.at(node, 0.1, tick)
    world.run(0.2)
    assert seen == [(False, 0.11), (True, 0.13)]


def test_a_thread_that_reads_a_queue_ends_with_the_run(world: World) -> None:
    node = world.node()
    jobs: queue.Queue[int] = queue.Queue()
    done: list[tuple[int, float]] = []

    def work() -> None:
        while True:
            try:
                job = jobs.get(timeout=0.001)
            except queue.Empty:
                continue
            time.sleep(0.005)
            done.append((job, round(seconds(node), 6)))

    thread = threading.Thread(target=work)
    world.at(node, 0.0, thread.start)
    for number in range(3):
        world.at(node, 0.01 * (number + 1), functools.partial(jobs.put, number))
    world.run(0.05)
    assert done == [(0, 0.015), (1, 0.025), (2, 0.035)]
    assert thread.is_alive()
    world.close()
    thread.join(5.0)
    assert not thread.is_alive()


def test_a_thread_that_waits_for_a_socket_leaves_the_run_with_a_note(world: World) -> None:
    node = world.node()
    ours, its = socket.socketpair()
    received: list[tuple[bytes, float]] = []

    def listen() -> None:
        while data := its.recv(10):
            received.append((data, time.time()))

    thread = threading.Thread(target=listen, name="listener")
    with ours, its:
        node.create_timer(0.1, lambda: thread.is_alive() or thread.start())
        world.run(0.3)
        (note,) = world.notes
        assert "`listener` of /node" in note
        assert "test_system.py:" in note
        ours.send(b"message")
        ours.shutdown(socket.SHUT_WR)
        thread.join(5.0)
    ((data, received_s),) = received
    assert data == b"message"
    assert received_s > 1e9  # the system time


def test_a_thread_that_only_computes_is_an_error_with_its_stack(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guest_thread, "LONGEST_TURN_S", 0.3)
    node = world.node()
    ended = threading.Event()

    def computes_for_ever() -> None:
        while not ended.is_set():
            pass

    thread = threading.Thread(target=computes_for_ever, name="users")
    world.at(node, 0.1, thread.start)
    with pytest.raises(LockstepError, match=r"`users` of /node(.|\n)*in computes_for_ever"):
        world.run(0.2)
    ended.set()
    thread.join(5.0)
    assert not thread.is_alive()


def test_a_guest_thread_sleeps_in_simulated_time(world: World) -> None:
    node = world.node()
    seen: list[tuple[float, float]] = []
    stop = threading.Event()

    def loop() -> None:
        while not stop.is_set():
            seen.append((seconds(node), time.time()))
            time.sleep(0.01)
            stop.wait(0.01)

    thread = node.surroundings.make_thread(node, loop, "guest")
    thread.start()
    world.run(0.05)
    assert seen == [(0.0, 0.0), (0.02, 0.02), (0.04, 0.04)]
    stop.set()
    thread.join()
    assert not thread.is_alive()


def test_a_guest_thread_that_does_not_notice_its_end_is_ended(world: World) -> None:
    node = world.node()
    rounds: list[int] = []

    def loop() -> None:
        while True:
            rounds.append(1)
            time.sleep(0.01)

    thread = node.surroundings.make_thread(node, loop, "guest")
    thread.start()
    world.run(0.025)
    thread.join()
    assert not thread.is_alive()
    assert len(rounds) == 3 + 2


def test_a_guest_thread_that_never_sleeps_is_an_error_with_its_stack(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guest_thread, "LONGEST_TURN_S", 0.3)
    node = world.node()
    ended = threading.Event()

    def computes_for_ever() -> None:
        while not ended.is_set():
            pass

    thread = node.surroundings.make_thread(node, computes_for_ever, "guest")
    thread.start()
    with pytest.raises(LockstepError, match=r"`guest` of /node(.|\n)*in computes_for_ever"):
        world.run(0.1)
    ended.set()
    thread.join()
    assert not thread.is_alive()


def test_a_negative_sleep_raises_as_in_a_real_run(world: World) -> None:
    def sleep() -> None:
        with pytest.raises(ValueError, match="non-negative"):
            time.sleep(-0.001)

    _in_callback(world, sleep)


def test_a_sleep_that_takes_no_time_is_not_noted(world: World) -> None:
    _in_callback(world, lambda: time.sleep(0))
    assert not world.notes


@pytest.mark.usefixtures("short_limit")
@pytest.mark.parametrize("is_in_thread", [False, True], ids=["callback", "thread"])
def test_a_loop_that_sleeps_for_the_time_left_ends(world: World, is_in_thread: bool) -> None:
    node = world.node()
    end_s = float(np.nextafter(0.15, 1.0))  # at 0.15 s, less than a nanosecond is left
    ended: list[float] = []

    def wait() -> None:
        while (left_s := end_s - time.monotonic()) > 0:
            time.sleep(left_s)
        ended.append(time.monotonic())

    world.at(node, 0.1, threading.Thread(target=wait).start if is_in_thread else wait)
    world.run(0.2)
    assert ended == pytest.approx([end_s])


def test_a_loop_waits_for_the_result_of_a_thread_before_its_time_limit(world: World) -> None:
    started = threading.Event()

    def compute() -> int:
        started.wait()
        end_s = time.thread_time() + 0.02
        while time.thread_time() < end_s:
            pass
        return 5

    async def wait() -> int:
        result = asyncio.create_task(asyncio.to_thread(compute))
        await asyncio.sleep(0)
        started.set()
        return await asyncio.wait_for(result, 60.0)

    assert _in_callback(world, lambda: (asyncio.run(wait()), time.time())) == (5, 1.5)


def test_threads_outside_lockstep_change_no_waits_of_other_nodes(world: World) -> None:
    node, other = world.node(), world.node("other")
    is_set = threading.Event()
    woken: list[float] = []

    def set_later() -> None:
        time.sleep(0.05)
        is_set.set()

    def wait() -> None:
        threading.Thread(target=set_later).start()
        is_set.wait(1.0)
        woken.append(seconds(node))

    world.at(other, 0.1, lambda: asyncio.run(asyncio.to_thread(lambda: None)))
    world.at(node, 0.2, wait)
    world.run(2.0)
    assert woken == [pytest.approx(0.25)]


CHILD_WAITS: dict[str, Callable[[subprocess.Popen[bytes], float], object]] = {
    "wait": lambda child, limit_s: child.wait(limit_s),
    "communicate": lambda child, limit_s: child.communicate(timeout=limit_s),
}


@pytest.mark.parametrize("name", CHILD_WAITS)
def test_the_time_limit_of_a_child_process_is_real_time(world: World, name: str) -> None:
    wait = CHILD_WAITS[name]

    def wait_for_child() -> float:
        with subprocess.Popen(["sleep", "600"], stdout=subprocess.PIPE) as child:
            with pytest.raises(subprocess.TimeoutExpired):
                wait(child, 0.05)
            child.kill()
            wait(child, 60.0)
        return time.time()

    assert _in_callback(world, wait_for_child) == 1.5
    assert not world.notes


def test_the_time_limit_of_a_pipe_of_multiprocessing_is_real_time(world: World) -> None:
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        assert _in_callback(world, lambda: (ours.poll(0.05), time.time())) == (False, 1.5)


def test_the_time_limit_of_a_queue_of_multiprocessing_is_real_time(world: World) -> None:
    numbers: Any = multiprocessing.Queue()

    def wait() -> float:
        with pytest.raises(queue.Empty):
            numbers.get(timeout=0.05)
        return time.time()

    assert _in_callback(world, wait) == 1.5


def test_a_thread_computes_on_a_busy_machine(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guest_thread, "LONGEST_TURN_S", 0.3)
    node = world.node()
    computed: list[bool] = []

    def compute() -> None:
        end_s = time.thread_time() + 0.2
        while time.thread_time() < end_s:
            pass
        computed.append(True)

    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        world.at(node, 0.1, threading.Thread(target=compute).start)
        world.run(0.2)
    finally:
        for process in busy:
            process.kill()
            process.wait()
        os.sched_setaffinity(0, cores)
    assert computed


@pytest.fixture
def short_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(callback_limit, "LONGEST_CALLBACK_S", 0.2)
    monkeypatch.setattr(callback_limit, "POLL_S", 0.05)


def _computes_for_ever() -> None:
    while True:
        pass


@pytest.mark.usefixtures("short_limit")
def test_a_callback_that_never_ends_is_an_error_with_its_place(world: World) -> None:
    world.at(world.node(), 0.1, _computes_for_ever)
    with pytest.raises(LockstepError, match=r"/node .*test_system\.py:\d+"):
        world.run(0.2)
    assert world.t == pytest.approx(0.1)


@pytest.mark.usefixtures("short_limit")
def test_a_callback_that_catches_the_error_still_ends_the_run(world: World) -> None:
    def compute() -> None:
        with suppress(LockstepError):
            _computes_for_ever()

    world.at(world.node(), 0.1, compute)
    with pytest.raises(LockstepError, match="/node "):
        world.run(0.2)


@pytest.mark.usefixtures("short_limit")
def test_a_constructor_that_never_ends_is_an_error_with_its_place(world: World) -> None:
    class Endless(GuardedLifecycleNode):
        def __init__(self, name: str) -> None:
            super().__init__(name)
            _computes_for_ever()

    with pytest.raises(LockstepError, match=r"/node .*test_system\.py:\d+"):
        world.node(make=Endless)


@pytest.mark.usefixtures("short_limit")
def test_the_limit_is_for_one_callback_not_for_all(world: World) -> None:
    node = world.node()
    end = time.thread_time() + 0.5
    while time.thread_time() < end:
        world.at(node, world.t, lambda: None)
        world.run(0.001)


def test_logs_have_the_simulated_time_and_their_location(world: World) -> None:
    node = world.node()
    world.at(node, 0.25, lambda: node.get_logger().warning("look at this"))
    world.run(0.3)
    (entry,) = world.lockstep.interception.log
    assert (entry.time_ns, entry.severity, entry.text) == (250_000_000, 30, "look at this")
    assert "test_system.py:" in entry.place


def test_a_throttled_log_is_throttled_by_simulated_time(world: World) -> None:
    node = world.node()
    logger = node.get_logger()
    node.create_timer(0.01, lambda: logger.info("often", throttle_duration_sec=0.05))
    world.run(0.2)
    assert world.log.count("often") == 4
