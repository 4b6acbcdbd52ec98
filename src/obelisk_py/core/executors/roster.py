"""Which runner stands for which entity, and on which lanes: kept equal to what the nodes have.

A mutually exclusive callback group lives on one lane, so that exclusion costs nothing; a reentrant
one on all of them. A runner that has to go is silenced at once, leaves each lane on that lane's own
thread, and is closed when it has left the last.
"""

import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle

from obelisk_py.core.executors.auxiliary import (
    AuxiliaryRunner,
    AuxiliaryThread,
    GuardRunner,
    WaitableRunner,
)
from obelisk_py.core.executors.entities import (
    ClientRunner,
    EventRunner,
    ExecutorReference,
    Runner,
    ServiceRunner,
    SubscriptionRunner,
)
from obelisk_py.core.executors.jobs import JobQueue
from obelisk_py.core.executors.lane import Job, Lane
from obelisk_py.core.executors.timers import TimerRunner

__all__ = ["Roster"]


class Roster:
    """The runners of all entities."""

    def __init__(
        self,
        lanes: Sequence[Lane],
        jobs: JobQueue,
        auxiliary: AuxiliaryThread,
        executor: ExecutorReference,
    ) -> None:
        self.is_outdated = False
        """Entities came or went since the last `update`."""
        self.lock = threading.RLock()
        """Held while a lane gets or loses its thread, which `update` must not see half done."""
        self._lanes = lanes
        self._jobs = jobs
        self._auxiliary = auxiliary
        self._executor = executor
        # By identity; a runner keeps its entity, so the number is not given to another one.
        self._runners: dict[int, Runner] = {}
        self._leaving: dict[Runner, set[Lane]] = {}
        self._auxiliary_runners: dict[int, AuxiliaryRunner] = {}
        self._groups: weakref.WeakKeyDictionary[CallbackGroup, Lane] = weakref.WeakKeyDictionary()

    def update(self, nodes: Iterable[Any]) -> None:
        """Make runners for entities that are new and let those go whose entity is gone."""
        with self.lock:
            self.is_outdated = False
            listed = {id(entity): (make, entity) for make, entity in _entities(nodes)}
            for key in self._runners.keys() - listed.keys():
                self._let_go(self._runners.pop(key))
            for key in listed.keys() - self._runners.keys():
                self._enlist(key, *listed[key])
            self._update_auxiliary(nodes)

    def clear(self) -> None:
        """Let every runner go at once; only while no lane has a thread."""
        self.update(())
        for lane in self._lanes:
            self.let_leave(lane)

    def let_leave(self, lane: Lane) -> None:
        """Take from a lane that no thread runs what it has not let go itself."""
        with self.lock:
            for runner in list(self._leaving):
                self._leave(runner, lane)

    def _enlist(self, key: int, make: Callable[..., Runner], entity: Any) -> None:
        try:
            runner = make(entity, self._executor)
        except InvalidHandle:  # destroyed meanwhile
            return
        try:
            runner.listen()
        except RuntimeError:
            runner.close()
            raise
        lanes = self._lanes_of(runner.group)
        runner.is_shared = len(lanes) > 1
        for lane in lanes:
            lane.add(runner, shared=runner.is_shared)
        self._runners[key] = runner

    def _let_go(self, runner: Runner) -> None:
        runner.silence()
        lanes = self._lanes_of(runner.group)
        self._leaving[runner] = set(lanes)
        for lane in lanes:
            if lane.thread_id in (None, threading.get_ident()):
                self._leave(runner, lane)
            else:
                lane.post(partial(self._leave, runner))

    def _leave(self, runner: Runner, lane: Lane) -> bool:
        with self.lock:
            lanes = self._leaving.get(runner, set())
            if lane in lanes:
                lane.remove(runner)
                lanes.remove(lane)
                if not lanes:
                    del self._leaving[runner]
                    runner.close()
        return False

    def _lanes_of(self, group: CallbackGroup) -> Sequence[Lane]:
        if isinstance(group, ReentrantCallbackGroup):
            return self._lanes
        return [self._lane_of(group)]

    def _lane_of(self, group: CallbackGroup) -> Lane:
        """A group's lane; a new group's is the one with the fewest."""
        if group not in self._groups:
            taken = list(self._groups.values())
            self._groups[group] = min(self._lanes, key=taken.count)
        return self._groups[group]

    def _update_auxiliary(self, nodes: Iterable[Any]) -> None:
        listed = {id(entity): (make, entity) for make, entity in _auxiliary_entities(nodes)}
        gone = self._auxiliary_runners.keys() - listed.keys()
        new = listed.keys() - self._auxiliary_runners.keys()
        for key in gone:
            self._auxiliary_runners.pop(key).is_gone = True
        for key in new:
            make, entity = listed[key]
            post = self._post_to(entity.callback_group)
            self._auxiliary_runners[key] = make(entity, post, self._executor, self._auxiliary.wake)
        if gone or new:
            self._auxiliary.watch(tuple(self._auxiliary_runners.values()))

    def _post_to(self, group: CallbackGroup) -> Callable[[Job], None]:
        if isinstance(group, ReentrantCallbackGroup):
            return self._jobs.put
        return partial(self._lane_of(group).post, group=group)


def _auxiliary_entities(nodes: Iterable[Any]) -> Iterator[tuple[type[AuxiliaryRunner], Any]]:
    for node in nodes:
        for guard in list(node.guards):
            yield GuardRunner, guard
        for waitable in list(node.waitables):
            if not isinstance(waitable, EventHandler):
                yield WaitableRunner, waitable


def _entities(nodes: Iterable[Any]) -> Iterator[tuple[Callable[..., Runner], Any]]:
    for node in nodes:
        for make, entities in (
            (TimerRunner, node.timers),
            (partial(SubscriptionRunner, context=node.context), node.subscriptions),
            (ServiceRunner, node.services),
            (ClientRunner, node.clients),
            (EventRunner, [w for w in node.waitables if isinstance(w, EventHandler)]),
        ):
            for entity in list(entities):
                yield make, entity
