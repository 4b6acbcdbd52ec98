"""A worker runs callbacks in turn, returns when interrupted, and blocks exclusive groups."""

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
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


class Source:
    """A file descriptor and its callback."""

    def __init__(
        self,
        action: Callable[[Worker], Any],
        group: CallbackGroup | None = None,
        *,
        waits_for_group: bool = True,
    ) -> None:
        self.fd = open_eventfd()
        self.group = group
        self.waits_for_group = waits_for_group
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


def test_a_source_that_raises_is_handled_again_for_the_rest(world: World) -> None:
    def fail(_worker: Worker) -> None:
        world.log.append("fail")
        if len(world.log) == 1:
            raise ValueError("boom")

    source = world.source(fail)
    source.signal()
    with pytest.raises(ValueError, match="boom"):
        world.rounds(1)
    world.rounds(1)
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


def test_a_suspended_coroutine_continues_when_its_future_is_done(world: World) -> None:
    future = Future()
    coroutine_of(world, future, ReentrantCallbackGroup()).signal()
    world.rounds(5)
    assert world.log == ["begun"]
    future.set_result(None)
    world.rounds(1)
    assert world.log == ["begun", "over"]


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
    future.set_result(None)
    world.rounds(3)
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


def test_a_closed_worker_can_still_be_called() -> None:
    worker = Worker()
    worker.close()
    worker.interrupt()


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
    jobs.put(lambda _worker: True)


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
