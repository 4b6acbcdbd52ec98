"""Locks of nodes in lockstep, held by a thread that sleeps."""

import gc
import queue
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from obelisk_py.core.lifecycle import GuardedLifecycleNode
from obelisk_py.core.lockstep.locks import NodeLock
from obelisk_py.core.lockstep.scheduler import LockstepError

from .world import World, seconds

pytestmark = pytest.mark.ros

LOCKS: dict[str, Callable[[], Any]] = {
    "Lock": lambda: threading.Lock(),
    "RLock": lambda: threading.RLock(),
    "Condition": lambda: threading.Condition(),
    "Condition(Lock)": lambda: threading.Condition(threading.Lock()),
}


class Bus(GuardedLifecycleNode):
    """Its thread holds the lock for 4 of 6 ms."""

    lock: Any
    make_lock: Callable[[], Any]

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.lock = type(self).make_lock()
        self.acquired: list[float] = []
        self.thread = threading.Thread(target=self.transfer)

    def transfer(self) -> None:
        while True:
            with self.lock:
                time.sleep(0.004)
            time.sleep(0.002)

    def use(self, *arguments: Any) -> None:
        if self.lock.acquire(*arguments):
            self.acquired.append(seconds(self))
            self.lock.release()


def _idle_bus(world: World, name: str = "Lock") -> Bus:
    node: Bus = world.node(make=type("Bus", (Bus,), {"make_lock": staticmethod(LOCKS[name])}))
    return node


def _bus(world: World, name: str = "Lock") -> Bus:
    node = _idle_bus(world, name)
    world.at(node, 0.0, node.thread.start)
    return node


@pytest.mark.parametrize("arguments", [(), (True, 0.05)], ids=["without limit", "with limit"])
@pytest.mark.parametrize("name", LOCKS)
def test_a_callback_waits_for_a_lock_in_simulated_time(
    world: World, name: str, arguments: tuple[Any, ...]
) -> None:
    node = _bus(world, name)
    for t in (0.001, 0.011, 0.021):
        world.at(node, t, lambda: node.use(*arguments))
    world.run(0.03)
    assert node.acquired == pytest.approx([0.004, 0.011, 0.022], abs=1e-8)


def test_a_callback_gets_no_lock_after_its_time_limit(world: World) -> None:
    node = _bus(world)
    ended: list[float] = []
    world.at(node, 0.001, lambda: (node.use(True, 0.002), ended.append(seconds(node))))
    world.at(node, 0.005, lambda: node.use(False))
    world.at(node, 0.007, lambda: node.use(False))
    world.run(0.01)
    assert ended == pytest.approx([0.003], abs=1e-8)
    assert node.acquired == pytest.approx([0.005], abs=1e-8)


@pytest.mark.parametrize("name", LOCKS)
def test_a_thread_waits_for_a_lock_in_simulated_time(world: World, name: str) -> None:
    node = _bus(world, name)
    world.at(node, 0.0011, threading.Thread(target=node.use).start)
    world.run(0.03)
    (acquired,) = node.acquired
    assert 0.004 <= acquired <= 0.006
    assert not world.notes


def test_a_condition_is_notified_by_a_thread_that_keeps_its_lock(world: World) -> None:
    node = _idle_bus(world, "Condition")
    woken: list[float] = []

    def notify() -> None:
        with node.lock:
            node.lock.notify()
            time.sleep(0.01)

    def wait() -> None:
        with node.lock, node.lock:
            threading.Thread(target=notify).start()
            node.lock.wait()
            woken.append(seconds(node))
        assert not node.lock._is_owned()

    world.at(node, 0.1, wait)
    world.run(0.2)
    assert node.last_fault is None
    assert woken == pytest.approx([0.11], abs=1e-8)


def test_a_lock_that_the_callback_holds_itself_is_an_error_with_its_place(world: World) -> None:
    node = _idle_bus(world)

    def use_twice() -> None:
        with node.lock:
            node.use()

    world.at(node, 0.1, use_twice)
    with pytest.raises(LockstepError, match=r"/node .*test_locks\.py:\d+"):
        world.run(0.2)


def test_a_callback_waits_for_a_lock_of_a_thread_outside_lockstep(world: World) -> None:
    node = _idle_bus(world)
    ours, its = socket.socketpair()

    def listen() -> None:
        with node.lock:
            its.recv(1)

    thread = threading.Thread(target=listen)
    with ours, its:
        world.at(node, 0.1, thread.start)
        world.at(node, 0.2, lambda: (ours.send(b"1"), node.use()))
        world.run(0.3)
        thread.join(5.0)
    assert node.acquired == pytest.approx([0.2])


def test_waiting_in_vain_for_a_thread_outside_lockstep_takes_simulated_time(world: World) -> None:
    node = _idle_bus(world)
    ours, its = socket.socketpair()
    tries: list[float] = []

    def listen() -> None:
        with node.lock:
            its.recv(1)

    def try_until_the_deadline() -> None:
        while seconds(node) < 0.25:
            tries.append(seconds(node))
            assert not node.lock.acquire(timeout=0.02)

    thread = threading.Thread(target=listen)
    with ours, its:
        world.at(node, 0.1, thread.start)
        world.at(node, 0.2, try_until_the_deadline)
        world.run(0.3)
        ours.send(b"1")
        thread.join(5.0)
    assert tries == pytest.approx([0.2, 0.22, 0.24])


def test_a_simulator_of_the_user_may_hold_a_lock(world: World) -> None:
    node = _idle_bus(world)
    thread = node.surroundings.make_thread(node, node.transfer, "simulator")
    thread.start()
    world.at(node, 0.001, node.use)
    world.run(0.01)
    assert node.acquired == pytest.approx([0.004], abs=1e-8)
    thread.join()


def test_a_thread_that_waits_for_a_lock_ends_with_the_run(world: World) -> None:
    node = _bus(world)
    waiting = threading.Thread(target=node.use)
    node.lock.acquire()
    world.at(node, 0.1, waiting.start)
    world.run(0.2)
    world.close()
    for thread in (node.thread, waiting):
        thread.join(5.0)
        assert not thread.is_alive()


@pytest.mark.parametrize("name", ["Condition", "Condition(Lock)"])
def test_a_thread_that_waits_for_a_notification_ends_without_an_error(
    world: World, name: str, recwarn: pytest.WarningsRecorder
) -> None:
    node = _bus(world, name)

    def consume() -> None:
        with node.lock:
            node.lock.wait()

    consumer = threading.Thread(target=consume)
    world.at(node, 0.1, consumer.start)
    world.run(0.2)
    world.close()
    consumer.join(5.0)
    assert not consumer.is_alive()
    gc.collect()
    assert not [warning for warning in recwarn if "Thread" in str(warning.category)]


def test_only_code_of_nodes_gets_locks_in_simulated_time(world: World) -> None:
    node = world.node()
    made: list[Any] = []
    world.at(node, 0.1, lambda: made.extend((threading.Lock(), threading.RLock(), queue.Queue())))
    world.run(0.2)
    lock, reentrant, jobs = made
    assert isinstance(lock, NodeLock)
    assert isinstance(reentrant, NodeLock)
    assert not isinstance(jobs.mutex, NodeLock)
    assert not isinstance(threading.Lock(), NodeLock)
