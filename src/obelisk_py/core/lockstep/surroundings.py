"""Connect nodes to a lockstep run instead of DDS, clocks and threads, and step its simulators."""

import random
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Final

import numpy as np
import rclpy.node as rclpy_node
from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.service import Service
from rclpy.subscription import Subscription

from obelisk_py.core.lockstep.actions import ActionTable, lockstep_actions
from obelisk_py.core.lockstep.callback_limit import CallbackLimit
from obelisk_py.core.lockstep.entities import (
    LockstepRate,
    LockstepTimer,
    LockstepWatchdog,
    ServiceTable,
    adopt_client,
    make_clock,
)
from obelisk_py.core.lockstep.guest_thread import GuestThread
from obelisk_py.core.lockstep.interception import Interception, run_in_progress
from obelisk_py.core.lockstep.scheduler import (
    MESSAGE,
    NS_PER_S,
    STEP,
    LockstepError,
    ScheduledNode,
    Scheduler,
    TimingModel,
    user_place,
)
from obelisk_py.core.lockstep.tasks import LockstepExecutor
from obelisk_py.core.lockstep.topics import (
    LockstepLifecyclePublisher,
    LockstepPublisher,
    RoutedPublisher,
    TopicTable,
)
from obelisk_py.core.shared_clock import is_of_time_source
from obelisk_py.core.surroundings import SteppedRobot, Surroundings, Watchdog, new_nodes_are_in
from obelisk_py.core.timer_phase import LoopStage

__all__ = ["LockstepRun", "LockstepSurroundings", "StepEvents"]


_UNSUPPORTED_EVENTS: Final = ("DEADLINE", "LIVELINESS", "MATCHED", "MESSAGE_LOST")


class StepEvents(threading.Thread):
    """Steps a robot from scheduled events; it never runs as a thread."""

    def __init__(self, scheduler: Scheduler, node: ScheduledNode, robot: SteppedRobot) -> None:
        """Create it without scheduling a step."""
        super().__init__(name="simulator", daemon=True)
        self.robot: Any = robot
        self.after_step: list[Callable[[], None]] = []
        self._scheduler = scheduler
        self._node = node
        self._guarded = node.node.guarded(self._step)
        self._is_stopped = False

    def start(self) -> None:
        """Schedule the first step, one step time from now."""
        self._push()

    def is_alive(self) -> bool:
        """Always false: it stops immediately."""
        return False

    def join(self, timeout: float | None = None) -> None:
        """Take no further steps."""
        del timeout
        self._is_stopped = True

    def _push(self) -> None:
        due_ns = self._scheduler.now_ns + self.robot.next_step_ns()
        self._scheduler.push(due_ns, STEP, self._node, self._guarded)

    def _step(self) -> None:
        if self._is_stopped:
            return
        self.robot.step_once()
        for call in self.after_step:
            call()
        self._push()


class LockstepRun:
    """A run: its time, its nodes, and everything that connects them."""

    def __init__(
        self,
        *,
        seed: int = 0,
        timing: TimingModel | None = None,
        watched: Iterable[str] = (),
        is_recorded: Callable[[str], bool] = lambda _: True,
        on_simulator: Callable[[StepEvents], None] = lambda _: None,
    ) -> None:
        """Create a run at time 0 without nodes.

        Args:
            seed: seed of all random numbers.
            timing: message latencies; None for no latency.
            watched: topics that count as subscribed even without a subscriber.
            is_recorded: whether the messages of a topic are recorded.
            on_simulator: called with each simulator before its first step.
        """
        self.seed = seed
        self.scheduler = Scheduler(seed=seed, timing=timing)
        self.topics = TopicTable(self.scheduler, watched=watched, is_recorded=is_recorded)
        self.services = ServiceTable(self.scheduler)
        self.actions = ActionTable(self.scheduler)
        self.executor = LockstepExecutor(self.scheduler)
        self.interception = Interception(
            scheduler=self.scheduler,
            entropy=random.Random(f"entropy {seed}"),  # noqa: S311
        )
        self.nodes: dict[str, ScheduledNode] = {}
        """The nodes by full name."""
        self.simulators: dict[str, StepEvents] = {}
        """The simulators by their node's full name."""
        self.on_simulator = on_simulator
        self.clock = make_clock(self.scheduler)
        self._generators = _GlobalGenerators(seed)
        self.faults: list[str] = []
        """Why nodes' processes ended."""
        self.scheduler.on_exit = self._end
        self._limit = CallbackLimit(self.scheduler)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Inside the `with` block, new nodes join this run and use its time and randomness."""
        with ExitStack() as stack:
            stack.enter_context(self._generators.in_place())
            stack.enter_context(run_in_progress(self.interception))
            stack.enter_context(lockstep_actions(self.actions))
            stack.enter_context(new_nodes_are_in(LockstepSurroundings(self)))
            yield

    def make_node(self, name: str, make: Callable[[], Any], compute_s: float = 0.0) -> Any:
        """Create a node of the run.

        Args:
            name: full name of the node.
            make: creates an instance of its class.
            compute_s: computing time of each of its callbacks [s].
        """
        scheduled = ScheduledNode(name=name, node=None, compute_ns=round(compute_s * NS_PER_S))
        self.nodes[name] = scheduled
        node = self.scheduler.run_as(scheduled, make)
        self.executor.add_node(node)
        return node

    def scheduled(self, node: Any) -> ScheduledNode:
        """Return the scheduled node that owns a node, which may be under construction."""
        owner = getattr(node, "_scheduled", None)
        if owner is None:
            owner = self.scheduler.running
            assert owner is not None
            node._scheduled = owner
            if owner.node is None:
                owner.node = node
            else:
                owner.others.append(node)
        return owner

    def _end(self, node: ScheduledNode, how: str) -> None:
        """Kill a node whose code exits its process, and record why."""
        self.scheduler.note(("end", node.name), f"{node.name} {how}")
        self.faults.append(f"{node.name} {how} at {self.scheduler.time_ns / NS_PER_S:.6f} s")
        self.kill(node)

    def kill(self, node: ScheduledNode) -> None:
        """Stop a node as SIGKILL would stop its process: none of its code runs after this."""
        node.is_alive = False
        self.topics.leave(node)
        self.services.leave(node)
        self.actions.leave(node)
        self.simulators.pop(node.name, None)

    def close(self) -> None:
        """Stop the threads of the run and of the nodes' code, and release all nodes."""
        self._limit.close()
        for guest in self.interception.guests:
            guest.end()
        self.scheduler.clear()
        self.nodes.clear()
        self.simulators.clear()
        for topic in self.topics.by_name.values():
            topic.subscribers = ()
            topic.publishers.clear()
        self.executor.shutdown()


class _GlobalGenerators:
    """The states of `random` and `numpy.random` for the nodes of one run.

    Random numbers drawn by a test or another run in between do not affect these nodes.
    """

    def __init__(self, seed: int) -> None:
        self._states: tuple[Any, Any] = (
            random.Random(seed).getstate(),  # noqa: S311
            np.random.RandomState(seed % 2**32).get_state(),
        )

    @contextmanager
    def in_place(self) -> Iterator[None]:
        before = random.getstate(), np.random.get_state()
        random.setstate(self._states[0])
        np.random.set_state(self._states[1])
        try:
            yield
        finally:
            self._states = random.getstate(), np.random.get_state()
            random.setstate(before[0])
            np.random.set_state(before[1])


class LockstepSurroundings(Surroundings):
    """A lockstep run instead of DDS, clocks and threads."""

    is_lockstep = True

    def __init__(self, run: LockstepRun) -> None:
        """Connect nodes to `run`."""
        self._run = run
        self._scheduler = run.scheduler
        self.noise_seed = run.seed

    @contextmanager
    def construction(self, node: Any) -> Iterator[None]:
        """Entered while rclpy constructs a node, so that the node uses the run's clock."""
        owner = self._run.scheduled(node)
        module: Any = rclpy_node
        ros_clock, module.ROSClock = module.ROSClock, lambda: self._run.clock
        try:
            yield
        finally:
            module.ROSClock = ros_clock
        if owner.node is not node:
            # A node created by another node shares its turns.
            self._run.executor.add_node(node)

    def publisher_class(self, context: Any, *, has_lifecycle: bool) -> Any:
        """Return the class of a new publisher."""
        del context
        return LockstepLifecyclePublisher if has_lifecycle else LockstepPublisher

    def create_timer(self, node: Any, create: Any, *args: Any, **kwargs: Any) -> Any:
        """Create a timer."""
        del create
        return self._create_timer(node, *args, **kwargs)

    def start_timer(self, timer: LockstepTimer, stage: LoopStage) -> None:
        """Start a stopped timer; the run's timing model determines its phase."""
        del stage
        timer.reset()

    def _create_timer(
        self,
        node: Any,
        timer_period_sec: float,
        callback: Any,
        callback_group: Any = None,
        clock: Any = None,
        autostart: bool = True,
    ) -> LockstepTimer:
        timer = LockstepTimer(
            self._scheduler,
            self._run.scheduled(node),
            callback,
            period_ns=int(float(timer_period_sec) * NS_PER_S),
            clock=clock or node.get_clock(),
            autostart=autostart,
        )
        timer.callback_group = callback_group or node.default_callback_group
        timer.callback_group.add_entity(timer)
        node._timers.append(timer)
        return timer

    def create_rate(self, node: Any, create: Any, frequency: float, clock: Any = None) -> Any:
        """Create a rate.

        Raises:
            ValueError: the frequency is not positive.
        """
        del node, create, clock
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        return LockstepRate(self._scheduler, round(NS_PER_S / frequency))

    def clock_feed(self, node: Any, callback: Any) -> Any | None:
        """Return what replaces the time source's `/clock` subscription; None for any other."""
        del node
        return _NoFeed() if is_of_time_source(callback) else None

    def adopt(self, node: Any, entity: Any) -> None:
        """Connect an entity of a node to the run.

        The run ends with an error if a callback is for QoS events, which only DDS raises.
        """
        owner = self._run.scheduled(node)
        if isinstance(entity, RoutedPublisher):
            entity.join(self._run.topics, owner)
        elif isinstance(entity, Subscription):
            self._run.topics.subscribe(owner, entity)
        elif isinstance(entity, Service):
            self._run.services.add(owner, entity)
        elif isinstance(entity, Client):
            adopt_client(entity, self._scheduler, self._run.services, owner)
        elif isinstance(entity, ActionServer):
            entity._handle.attach(owner, entity)
        elif isinstance(entity, ActionClient):
            entity._client_handle.attach(owner, entity)
        elif isinstance(entity, GuardCondition):
            self._adopt_guard(owner, entity)
        elif isinstance(entity, EventHandler):
            name = getattr(entity.event_type, "name", "")
            if any(part in name for part in _UNSUPPORTED_EVENTS):
                self._scheduler.stop(
                    LockstepError(
                        f"{owner.name} has a callback for the QoS event {name} ({user_place()}), "
                        "which only DDS raises: it would never be called in lockstep"
                    )
                )

    def _adopt_guard(self, owner: ScheduledNode, guard: Any) -> None:
        def call() -> None:
            try:
                with guard.handle:
                    result = guard.callback()
            except InvalidHandle:
                return  # destroyed in the meantime
            if hasattr(result, "__await__"):
                self._run.executor.run_coroutine(result, owner)

        def trigger() -> None:
            with guard.handle:  # raises an exception if the guard condition is destroyed
                self._scheduler.push(self._scheduler.time_ns, MESSAGE, owner, call)

        guard.trigger = trigger

    def release(self, entity: Any) -> None:
        """Disconnect an entity before it is destroyed."""
        if isinstance(entity, Subscription):
            self._run.topics.unsubscribe(entity)
        elif isinstance(entity, Service):
            self._run.services.remove(entity)

    def make_thread(self, node: Any, target: Callable[[], None], name: str) -> threading.Thread:
        """Create a thread that takes turns with the scheduler."""
        thread = GuestThread(self._scheduler, self._run.scheduled(node), target, name)
        self._run.interception.guests.append(thread.lockstep_guest)
        return thread

    def make_watchdog(
        self, node: Any, deadline_s: Callable[[], float | None], check: Callable[[], None]
    ) -> Watchdog:
        """Create a watchdog whose checks are scheduled events."""
        return LockstepWatchdog(self._scheduler, self._run.scheduled(node), deadline_s, check)

    def drive(self, node: Any, robot: SteppedRobot) -> threading.Thread:
        """Step a simulated robot from scheduled events."""
        owner = self._run.scheduled(node)
        steps = StepEvents(self._scheduler, owner, robot)
        self._run.simulators[owner.name] = steps
        self._run.on_simulator(steps)
        return steps


class _NoFeed:
    """Replaces the subscription to `/clock`, because the clock already has the time."""

    def close(self) -> None:
        """Do nothing."""
