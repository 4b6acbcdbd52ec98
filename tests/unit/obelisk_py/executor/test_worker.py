"""A worker runs callbacks in turn, returns when interrupted, and blocks exclusive groups."""

import gc
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from rclpy.task import Future, Task

from obelisk_py.core.executor.rcl_listeners import open_eventfd
from obelisk_py.core.executor.worker import ReadyCallback, TaskQueue, Worker

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests


class Source:
    """A file descriptor and its callback."""

    def __init__(
        self,
        action: Callable[[Worker], Any],
        group: CallbackGroup | None = None,
        *,
        waits_for_group: bool = True,
        is_awaited: bool = False,
    ) -> None:
        self.fd = open_eventfd()
        self.group = group
        self.waits_for_group = waits_for_group
        self.is_awaited = is_awaited
        self._action = action

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        return {self.fd: partial(self._run, worker)}

    def signal(self) -> None:
        os.eventfd_write(self.fd, 1)

    def _run(self, worker: Worker) -> bool:
        self._action(worker)
        return True


class World:
    """A worker, a source, and a log."""

    def __init__(self) -> None:
        self.worker = Worker()
        self.log: list[str] = []
        self._fds: list[int] = []

    def source(self, action: str | Callable[[Worker], Any], **options: Any) -> Source:
        if isinstance(action, str):
            name = action
            source = Source(lambda _worker: self.log.append(name), **options)
        else:
            source = Source(action, **options)
        self._fds.append(source.fd)
        self.worker.add(source, shared=False)
        return source

    def rounds(self, number: int) -> None:
        for _ in range(number):
            if self.worker.is_interrupted:
                self.worker.is_interrupted = False
                self.worker.run_posted()
            self.worker.run_ready(0)

    def close(self) -> None:
        self.worker.close()
        for fd in self._fds:
            os.close(fd)


@pytest.fixture
def world() -> Iterator[World]:
    world = World()
    yield world
    world.close()


def test_a_signaled_descriptor_is_handled_once_per_signal(world: World) -> None:
    source = world.source("a")
    world.rounds(1)
    assert world.log == []
    source.signal()
    world.rounds(2)
    assert world.log == ["a"]
    source.signal()
    world.rounds(2)
    assert world.log == ["a", "a"]


def test_a_signal_from_before_it_was_watched_counts(world: World) -> None:
    source = Source(lambda _worker: world.log.append("early"))
    source.signal()
    world.worker.add(source, shared=False)
    world.rounds(1)
    world.worker.remove(source)
    os.close(source.fd)
    assert world.log == ["early"]


@pytest.mark.parametrize("is_own", [True, False])
def test_only_other_threads_signal_by_the_kernel(world: World, is_own: bool) -> None:
    source = world.source("a")
    world.worker.thread_id = threading.get_ident() if is_own else None
    world.worker.signal(source.fd)
    world.rounds(2)
    assert world.log == ["a"]
    if is_own:
        with pytest.raises(BlockingIOError):
            os.eventfd_read(source.fd)
    else:
        assert os.eventfd_read(source.fd) == 1


def test_interrupted_within_a_callback_it_leaves_the_others_for_the_next_round(
    world: World,
) -> None:
    first = world.source(lambda worker: (world.log.append("first"), worker.interrupt()))
    second = world.source("second")
    first.signal()
    second.signal()
    world.worker.run_ready(0)
    assert world.log == ["first"]
    world.rounds(1)
    assert world.log == ["first", "second"]


def test_a_source_removed_by_a_callback_is_not_handled_although_signaled(world: World) -> None:
    second = world.source("second")
    first = world.source(lambda worker: worker.remove(second))
    first.signal()
    second.signal()
    world.worker.requeue(first.fd)  # before the other one, in any order of the kernel
    world.rounds(2)
    assert "second" not in world.log


def test_removing_a_source_keeps_the_others(world: World) -> None:
    first, second = world.source("first"), world.source("second")
    world.worker.remove(first)
    first.signal()
    second.signal()
    world.rounds(1)
    assert world.log == ["second"]


def test_after_a_stop_only_what_a_callback_may_wait_for_is_handled(world: World) -> None:
    sources = [world.source("event"), world.source("response", is_awaited=True)]
    world.worker.ignore_unawaited()
    for source in sources:
        source.signal()
    world.rounds(1)
    assert world.log == ["response"]


def in_time(wait: Callable[[float], bool]) -> bool:
    """Whether a wait without a limit ends."""
    thread = threading.Thread(target=wait, args=(-1,), daemon=True)
    thread.start()
    thread.join(DEADLINE_S)
    return not thread.is_alive()


@pytest.mark.parametrize("method", [Worker.run_ready, Worker.run_one])
def test_it_does_not_wait_if_there_is_something_to_do(
    world: World, method: Callable[[Worker, float], bool]
) -> None:
    wait = partial(method, world.worker)
    source = world.source("a")
    world.worker.requeue(source.fd)
    assert in_time(wait)
    assert world.log == ["a"]
    world.worker.is_interrupted = True
    assert in_time(wait)


def test_an_interrupt_ends_a_wait(world: World) -> None:
    world.worker.interrupt()
    world.worker.is_interrupted = False
    assert in_time(world.worker.run_ready)


@pytest.mark.parametrize("method", [Worker.run_ready, Worker.run_one])
def test_it_waits_for_a_signal_and_reports_that_a_callback_ran(
    world: World, method: Callable[[Worker, float], bool]
) -> None:
    source = world.source("a")
    later = threading.Timer(0.05, source.signal)
    later.start()
    assert method(world.worker, DEADLINE_S)
    later.join()
    assert not world.worker.run_ready(0)


def test_run_one_handles_each_level_triggered_descriptor_once(world: World) -> None:
    source = world.source("unused")
    others = [open_eventfd() for _ in range(2)]

    def read(fd: int) -> bool:
        world.log.append(str(fd))
        return os.eventfd_read(fd) > 0

    for fd in others:
        world.worker.watch(source, fd, partial(read, fd))
        os.eventfd_write(fd, 1)
    for _ in range(4):
        world.worker.run_one(0)
    assert sorted(world.log) == sorted(map(str, others))
    world.worker.remove(source)
    for fd in others:
        os.close(fd)


def test_run_one_asks_callbacks_to_return_after_one_message(world: World) -> None:
    world.source(lambda worker: world.log.append(str(worker.is_interrupted))).signal()
    world.worker.run_one(0)
    assert world.log == ["True"]


def test_one_that_always_has_more_does_not_keep_others_from_their_turn(world: World) -> None:
    def flood(worker: Worker) -> None:
        world.log.append("flood")
        worker.requeue(flooding.fd)

    flooding = world.source(flood)
    other = world.source("other")
    flooding.signal()
    world.rounds(2)
    other.signal()
    world.rounds(2)
    assert (world.log.count("other"), world.log.count("flood")) == (1, 4)


def test_run_one_runs_one_callback_and_no_other_is_starved(world: World) -> None:
    def flood(worker: Worker) -> None:
        world.log.append("flood")
        worker.requeue(flooding.fd)

    flooding = world.source(flood)
    other = world.source("other")
    flooding.signal()
    assert world.worker.run_one(0)
    assert world.log == ["flood"]
    other.signal()
    for _ in range(2):
        world.worker.run_one(0)
    assert "other" in world.log


def test_run_one_reports_that_nothing_was_ready(world: World) -> None:
    world.source("a")
    assert not world.worker.run_one(0)


@pytest.mark.parametrize("method", [Worker.run_ready, Worker.run_one])
def test_a_source_that_raises_is_handled_again_for_the_rest(
    world: World, method: Callable[[Worker, float], bool]
) -> None:
    def fail(_worker: Worker) -> None:
        world.log.append("fail")
        if len(world.log) == 1:
            raise ValueError("boom")

    source = world.source(fail)
    source.signal()
    with pytest.raises(ValueError, match="boom"):
        method(world.worker, 0)
    world.rounds(2)
    assert world.log == ["fail", "fail"]


def test_a_posted_job_runs_after_an_interrupt(world: World) -> None:
    world.worker.post(lambda _worker: bool(world.log.append("job")))
    assert world.worker.is_interrupted
    world.rounds(1)
    assert world.log == ["job"]


def coroutine_of(world: World, future: Future, group: CallbackGroup) -> Source:
    async def wait() -> None:
        world.log.append("begun")
        await future
        world.log.append("over")

    return world.source(lambda worker: worker.run_task(Task(wait), group), group=group)


@pytest.mark.parametrize("method", [Worker.run_ready, Worker.run_one])
def test_a_suspended_coroutine_continues_when_its_future_is_done(
    world: World, method: Callable[[Worker, float], bool]
) -> None:
    future = Future()
    coroutine_of(world, future, ReentrantCallbackGroup()).signal()
    world.rounds(5)
    assert world.log == ["begun"]
    future.set_result(None)
    method(world.worker, 0)
    assert world.log == ["begun", "over"]


@pytest.mark.parametrize("timeout_s", [-1, 10 * DEADLINE_S], ids=["no limit", "limit"])
def test_a_suspended_coroutine_continues_when_another_thread_completes_its_future(
    world: World, timeout_s: float
) -> None:
    """Without a wake-up."""
    future = Future()
    coroutine_of(world, future, ReentrantCallbackGroup()).signal()
    world.rounds(1)

    def run(_timeout_s: float) -> bool:
        later = threading.Timer(0.05, future.set_result, (None,))
        later.start()
        while "over" not in world.log:
            world.worker.run_ready(timeout_s)
        later.join()
        return True

    assert in_time(run)


def test_a_coroutine_that_does_not_suspend_leaves_its_group_free(world: World) -> None:
    group = MutuallyExclusiveCallbackGroup()

    async def fail() -> None:
        raise ValueError("boom")

    async def end() -> None:
        world.log.append("end")

    for coroutine in (end, fail):
        source = world.source(lambda worker, c=coroutine: worker.run_task(Task(c), group))
        source.signal()
    with pytest.raises(ValueError, match="boom"):
        world.rounds(2)
    assert world.log == ["end"]
    assert not world.worker.is_blocked(group)


def test_an_exclusive_group_waits_for_its_suspended_coroutine(world: World) -> None:
    future, group = Future(), MutuallyExclusiveCallbackGroup()
    same = world.source("same", group=group)
    other = world.source("other", group=MutuallyExclusiveCallbackGroup())
    coroutine_of(world, future, group).signal()
    world.rounds(1)
    same.signal()
    other.signal()
    world.worker.post(lambda _worker: bool(world.log.append("same job")), group)
    world.rounds(5)
    assert world.log == ["begun", "other"]
    assert world.worker.is_blocked(group)
    future.set_result(None)
    world.rounds(3)
    assert not world.worker.is_blocked(group)
    assert sorted(world.log[2:]) == ["over", "same", "same job"]
    assert world.log[2] == "over"


def test_a_callback_that_need_not_wait_runs_while_its_group_is_held(world: World) -> None:
    future, group = Future(), MutuallyExclusiveCallbackGroup()
    response = world.source(
        lambda _worker: future.set_result(None), group=group, waits_for_group=False
    )
    coroutine_of(world, future, group).signal()
    world.rounds(1)
    response.signal()
    world.rounds(3)
    assert world.log == ["begun", "over"]


def test_callbacks_added_to_a_held_group_wait_too(world: World) -> None:
    future, group = Future(), MutuallyExclusiveCallbackGroup()
    coroutine_of(world, future, group).signal()
    world.rounds(1)
    world.source("new", group=group).signal()
    world.rounds(3)
    assert world.log == ["begun"]
    future.set_result(None)
    world.rounds(3)
    assert world.log == ["begun", "over", "new"]


def test_reentrant_callbacks_run_while_one_of_them_is_suspended(world: World) -> None:
    group = ReentrantCallbackGroup()
    same = world.source("same", group=group)
    coroutine_of(world, Future(), group).signal()
    world.rounds(1)
    same.signal()
    world.rounds(1)
    assert world.log == ["begun", "same"]


def test_an_exception_in_a_coroutine_leaves_the_round_and_frees_its_group(world: World) -> None:
    future, group = Future(), MutuallyExclusiveCallbackGroup()

    async def fail() -> None:
        await future
        raise ValueError("boom")

    same = world.source("same", group=group)
    world.source(lambda worker: worker.run_task(Task(fail), group), group=group).signal()
    world.rounds(1)
    future.set_result(None)
    with pytest.raises(ValueError, match="boom"):
        world.rounds(1)
    same.signal()
    world.rounds(2)
    assert world.log == ["same"]


def test_a_cancelled_coroutine_frees_its_group(world: World) -> None:
    group = MutuallyExclusiveCallbackGroup()
    tasks: list[Task] = []

    async def wait() -> None:
        await Future()

    def begin(worker: Worker) -> None:
        tasks.append(Task(wait))
        worker.run_task(tasks[0], group)

    same = world.source("same", group=group)
    world.source(begin, group=group).signal()
    world.rounds(1)
    tasks[0].cancel()
    same.signal()
    world.rounds(3)
    assert world.log == ["same"]


def test_what_was_closed_keeps_no_descriptors_and_can_still_be_called() -> None:
    def open_descriptors() -> int:
        gc.collect()  # those of earlier tests
        return len(list(Path("/proc/self/fd").iterdir()))

    before = open_descriptors()
    worker, jobs = Worker(), TaskQueue()
    worker.close()
    jobs.close()
    assert open_descriptors() == before
    worker.interrupt()
    jobs.put(lambda _worker: True)


def test_jobs_without_a_worker_run_one_per_turn_in_order(world: World) -> None:
    jobs = TaskQueue()
    world.worker.add(jobs, shared=False)
    for name in ("a", "b", "c"):
        jobs.put(lambda _worker, name=name: bool(world.log.append(name)))
    world.rounds(1)
    assert world.log == ["a"]
    world.rounds(2)
    assert world.log == ["a", "b", "c"]
    world.worker.remove(jobs)
    jobs.close()


def test_a_second_worker_takes_the_next_job_while_the_first_is_busy(world: World) -> None:
    jobs, other = TaskQueue(), Worker()
    for worker in (world.worker, other):
        worker.add(jobs, shared=True)

    def long(_worker: Worker) -> bool:
        other.run_ready(0)
        return True

    jobs.put(long)
    jobs.put(lambda worker: bool(world.log.append("other" if worker is other else "first")))
    world.worker.run_ready(0)
    assert world.log == ["other"]
    for worker in (world.worker, other):
        worker.remove(jobs)
    jobs.close()
    other.close()
