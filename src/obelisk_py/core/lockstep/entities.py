"""Clock, timers, rates, services and clients for nodes in lockstep, derived from rclpy's."""

import functools
import threading
from collections.abc import Callable
from typing import Any, cast

from rclpy.client import Client
from rclpy.clock import Clock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service
from rclpy.task import Future
from rclpy.time import Time
from rclpy.timer import Timer

from obelisk_py.core.lockstep.guest_thread import guest_of, take_time
from obelisk_py.core.lockstep.scheduler import (
    MESSAGE,
    NS_PER_S,
    TIMER,
    LockstepError,
    ScheduledNode,
    Scheduler,
    user_place,
)
from obelisk_py.core.lockstep.tasks import LockstepExecutor

__all__ = [
    "LockstepClient",
    "LockstepClock",
    "LockstepRate",
    "LockstepTimer",
    "LockstepWatchdog",
    "ServiceTable",
    "adopt_client",
    "make_clock",
]


class LockstepClock(ROSClock):
    """A clock that shows a scheduler's simulated time."""

    scheduler: Scheduler

    def now(self) -> Time:
        """Return the simulated time."""
        # Like the constructor, without its checks, which take twice as long as the rest.
        time = Time.__new__(Time)
        time._time_handle = rclpy_implementation.rcl_time_point_t(
            self.scheduler.time_ns, ClockType.ROS_TIME
        )
        return time

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Let the running callback take time until `until`; always returns true.

        Raises:
            ValueError: `until` has a different clock type.
        """
        del context
        if until.clock_type != self.clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        left_ns = until.nanoseconds - self.scheduler.time_ns
        if left_ns > 0:
            take_time(self.scheduler, left_ns / NS_PER_S)
        return True

    @property
    def ros_time_is_active(self) -> bool:
        """Always true: the time is simulated."""
        return True


def make_clock(scheduler: Scheduler) -> LockstepClock:
    """Create a clock for a scheduler."""
    # rclpy's constructor chooses the class by the clock type.
    clock = cast(Any, Clock(clock_type=ClockType.ROS_TIME))
    clock.__class__ = LockstepClock
    clock.scheduler = scheduler
    return cast(LockstepClock, clock)


class LockstepTimer(Timer):
    """A timer called by the scheduler, without an rcl timer."""

    def __init__(
        self,
        scheduler: Scheduler,
        node: ScheduledNode,
        callback: Callable[[], Any] | None,
        *,
        period_ns: int,
        clock: Clock,
        autostart: bool,
    ) -> None:
        """Create a timer.

        Args:
            scheduler: calls the timer.
            node: the timer's node.
            callback: called once per period.
            period_ns: simulated time between two calls [ns].
            clock: reported as the timer's clock.
            autostart: whether the timer starts now.
        """
        self.label = f"timer of {period_ns / NS_PER_S:g} s"
        self.callback: Any = callback
        self._scheduler = scheduler
        self._node = node
        self._clock = clock
        self._period_ns = period_ns
        self._number = scheduler.next_timer() << 32
        self._starts = 0
        """Number of starts; events of an earlier start have no effect."""
        self._is_canceled = True
        self._next_ns = 0
        self._last_ns: int | None = None
        self._made_ns = scheduler.time_ns
        self._executor_event = False
        if autostart:
            self.reset()

    @property
    def handle(self) -> Any:
        """The timer itself, because it has no C object."""
        return self

    def __enter__(self) -> "LockstepTimer":
        return self

    def __exit__(self, *_: object) -> None: ...

    def destroy(self) -> None:
        """Stop permanently."""
        self.cancel()

    @property
    def timer_period_ns(self) -> int:
        """Simulated time between two calls [ns]."""
        return self._period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        self._period_ns = int(value)  # takes effect after the next call, as in rcl

    def is_ready(self) -> bool:
        """Whether the timer is due."""
        return not self._is_canceled and self._next_ns <= self._scheduler.time_ns

    def is_canceled(self) -> bool:
        """Whether the timer is stopped."""
        return self._is_canceled

    def cancel(self) -> None:
        """Stop until `reset`."""
        self._is_canceled = True
        self._starts += 1

    def reset(self) -> None:
        """Start a new period now."""
        self._is_canceled = False
        self._starts += 1
        self._call = functools.partial(_call_timer, self, self._starts)
        phase_ns = self._scheduler.phase_ns(self._period_ns) if self._last_ns is None else 0
        self._next_ns = self._scheduler.time_ns + self._period_ns + phase_ns
        self._schedule()

    def time_since_last_call(self) -> int:
        """Simulated time since the last call, or since the timer was created [ns]."""
        last_ns = self._made_ns if self._last_ns is None else self._last_ns
        return self._scheduler.time_ns - last_ns

    def time_until_next_call(self) -> int | None:
        """Simulated time until the next call [ns]; None if the timer is stopped."""
        return None if self._is_canceled else self._next_ns - self._scheduler.time_ns

    def _schedule(self) -> None:
        place = self._number + self._starts
        self._scheduler.push_at_place(self._next_ns, TIMER, place, self._node, self._call)


def _call_timer(timer: LockstepTimer, start: int) -> bool:
    if start != timer._starts:
        return False
    scheduler, period_ns = timer._scheduler, timer._period_ns
    now_ns = timer._last_ns = scheduler.now_ns
    timer._next_ns += period_ns
    if timer._next_ns <= now_ns and period_ns:
        # Like rcl_timer_call, skip missed periods.
        timer._next_ns += (1 + (now_ns - timer._next_ns) // period_ns) * period_ns
    timer._schedule()
    if timer.callback is None:
        return True
    result = timer.callback()
    if result is not None and hasattr(result, "__await__"):
        executor = timer._node.node.executor
        assert isinstance(executor, LockstepExecutor)
        executor.run_coroutine(result, timer._node)
    return True


class LockstepRate:
    """A rate whose `sleep` takes simulated time until the next period."""

    def __init__(self, scheduler: Scheduler, period_ns: int) -> None:
        """Create a rate whose first period starts now; `period_ns` [ns]."""
        self._scheduler = scheduler
        self._period_ns = period_ns
        self._next_ns = scheduler.time_ns + period_ns
        self._is_destroyed = False
        self._timer = None  # read by `Node.destroy_rate`

    def sleep(self) -> None:
        """Sleep until the next multiple of the period.

        Raises:
            RuntimeError: the rate was destroyed.
        """
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        now_ns = self._scheduler.time_ns
        while self._next_ns <= now_ns:
            self._next_ns += self._period_ns
        take_time(self._scheduler, (self._next_ns - now_ns) / NS_PER_S)

    def destroy(self) -> None:
        """Make later calls to `sleep` raise an exception."""
        self._is_destroyed = True


class LockstepWatchdog:
    """Checks the age of commands in events; see `WatchdogThread`."""

    def __init__(
        self,
        scheduler: Scheduler,
        node: ScheduledNode,
        deadline_s: Callable[[], float | None],
        check: Callable[[], None],
    ) -> None:
        """Create a watchdog without starting it; for the arguments see `WatchdogThread`."""
        self._scheduler = scheduler
        self._node = node
        self._deadline_s = deadline_s
        self._check = check
        self._is_running = False
        self._is_armed = False

    def start(self) -> None:
        """Start checking."""
        self._is_running = True
        self._arm()

    def wake(self) -> None:
        """Read the deadline again; call this when a deadline is set after there was none."""
        self._arm()

    def stop(self, timeout_s: float) -> bool:
        """Stop; always returns true."""
        del timeout_s
        self._is_running = False
        return True

    def _arm(self) -> None:
        deadline_s = self._deadline_s()
        if self._is_armed or not self._is_running or deadline_s is None:
            return
        self._is_armed = True
        # One nanosecond later, so that the rounded time is not before the deadline.
        due_ns = max(int(deadline_s * NS_PER_S) + 1, self._scheduler.now_ns + 1)
        self._scheduler.push(due_ns, MESSAGE, self._node, self._look)

    def _look(self) -> bool:
        self._is_armed = False
        if not self._is_running:
            return False
        deadline_s = self._deadline_s()
        if deadline_s is not None and deadline_s * NS_PER_S <= self._scheduler.time_ns:
            self._check()
        self._arm()
        return True


class ServiceTable:
    """The services of a run, by full name."""

    def __init__(self, scheduler: Scheduler) -> None:
        """Create an empty table."""
        self._scheduler = scheduler
        self._services: dict[str, tuple[Service, ScheduledNode]] = {}

    def add(self, node: ScheduledNode, service: Service) -> None:
        """Make a node's service available to clients."""
        self._services[service.service_name] = (service, node)

    def remove(self, service: Service) -> None:
        """Reject all further calls to the service."""
        known = self._services.get(service.service_name)
        if known is not None and known[0] is service:
            del self._services[service.service_name]

    def leave(self, node: ScheduledNode) -> None:
        """Remove a node's services."""
        for service, owner in list(self._services.values()):
            if owner is node:
                self.remove(service)

    def names(self) -> list[str]:
        """Names of the available services."""
        return sorted(self._services)

    def has(self, name: str) -> bool:
        """Whether a node serves this name."""
        return name in self._services

    def request_class(self, name: str) -> type[Any]:
        """Return the class of a service's requests.

        Raises:
            KeyError: no node serves this name.
        """
        kind: Any = self._services[name][0].srv_type
        request_class: type[Any] = kind.Request
        return request_class

    def call(
        self, name: str, request: Any, client: ScheduledNode | None, answered: Callable[[Any], None]
    ) -> None:
        """Call a service: one event of the server, then one of the client.

        Args:
            name: full name of the service.
            request: the request.
            client: the calling node; None for the test.
            answered: called with the response.
        """
        if name not in self._services:
            self._scheduler.note(
                ("service", name), f"no node serves {name}: its future will never complete"
            )
            return
        service, server = self._services[name]
        scheduler = self._scheduler

        def answer() -> None:
            if self._services.get(name, (None,))[0] is not service:
                return
            kind: Any = service.srv_type
            response = service.callback(request or kind.Request(), kind.Response())
            if hasattr(response, "__await__"):
                executor = server.node.executor
                executor.run_coroutine(_await_response(response, respond), server)
            else:
                respond(response)

        def respond(response: Any) -> None:
            due_ns = scheduler.time_ns + server.compute_ns + scheduler.delay_ns(name)
            scheduler.push(due_ns, MESSAGE, client, functools.partial(answered, response))

        scheduler.push(scheduler.time_ns + scheduler.delay_ns(name), MESSAGE, server, answer)


async def _await_response(response: Any, respond: Callable[[Any], None]) -> None:
    respond(await response)


class LockstepClient(Client):
    """A client whose requests go to the run's services; `adopt_client` converts rclpy's clients."""

    services: ServiceTable
    scheduler: Scheduler
    owner: ScheduledNode
    is_destroyed = False

    def call_async(self, request: Any) -> Future:
        """Send a request and return a future of the response.

        Raises:
            TypeError: the request has the wrong type.
        """
        kind: Any = self.srv_type
        if not isinstance(request, kind.Request):
            raise TypeError(f"Expected {kind.Request}, got {type(request)}")
        future = Future(executor=self.owner.node.executor)

        def answered(response: Any) -> None:
            if not self.is_destroyed and not future.done():
                future.set_result(response)

        self.services.call(self.service_name, request, self.owner, answered)
        return future

    def destroy(self) -> None:
        """Destroy the client; later responses are dropped."""
        self.is_destroyed = True
        super().destroy()

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response; only on one of the node's own threads.

        Raises:
            LockstepError: called in a callback, where waiting for the response is a deadlock.
        """
        guest = guest_of(threading.current_thread())
        if guest is None:
            raise self.scheduler.stop(
                LockstepError(
                    f"{self.owner.name} waits in a callback for the response of "
                    f"{self.service_name} ({user_place()}): with one thread that is a deadlock. "
                    "Use call_async with `await` or a done callback"
                )
            )
        future = self.call_async(request)
        guest.wait_for(future.done, timeout_sec)
        return future.result()

    def service_is_ready(self) -> bool:
        """Whether a node provides this service."""
        return self.services.has(self.service_name)

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a node provides this service; in a callback, waiting takes the whole timeout.

        Raises:
            LockstepError: a callback waits without a timeout, and no node provides the service.
        """
        guest = guest_of(threading.current_thread())
        if guest is not None:
            guest.wait_for(self.service_is_ready, timeout_sec)
        elif not self.service_is_ready() and timeout_sec is None:
            raise self.scheduler.stop(
                LockstepError(
                    f"{self.owner.name} waits without a timeout for the service "
                    f"{self.service_name} ({user_place()}), which no node serves"
                )
            )
        elif not self.service_is_ready() and timeout_sec:
            self.scheduler.sleep(timeout_sec)
        return self.service_is_ready()


def adopt_client(
    client: Any, scheduler: Scheduler, services: ServiceTable, owner: ScheduledNode
) -> None:
    """Connect an rclpy client to the services of a run."""
    client.__class__ = LockstepClient
    client.scheduler, client.services, client.owner = scheduler, services, owner
