"""Handlers that run the callbacks of timers, subscriptions, services, clients and QoS events.

A handler keeps its entity's rcl structure alive and owns an eventfd, which the middleware signals
when data is available. A timer's handler also owns a kernel timer. A handler returns after any
callback during which its worker was interrupted, because the callback may have destroyed the
entity.
"""

import inspect
import os
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar

from rclpy.clock import JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Task
from rclpy.timer import Timer

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.executor.early_wakeup import EarlyWakeup
from obelisk_py.core.executor.local_receiver import LocalReceiver, open_receiver
from obelisk_py.core.executor.rcl_listeners import (
    EntityKind,
    arm_timer,
    clear_listener,
    open_eventfd,
    open_timer,
    set_listener,
)
from obelisk_py.core.executor.worker import EventSource, ReadyCallback, Worker
from obelisk_py.core.intra_process import buffer_of, intra_process_topic
from obelisk_py.core.serialization.codec import codec_for

__all__ = [
    "ClientHandler",
    "EntityHandler",
    "ExecutorReference",
    "QosEventHandler",
    "RCLError",
    "ServiceHandler",
    "SubscriptionHandler",
    "TimerCallbackHandler",
    "TimerHandler",
]

ExecutorReference = Callable[[], Executor | None]
"""Returns the executor; None if it was garbage-collected."""

RCLError: Any = rclpy_implementation.RCLError
_IMMEDIATELY_NS = 1
_ANY_JUMP = JumpThreshold(
    min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=True
)

_MESSAGES_PER_TURN = 32
"""Number of messages after which the other handlers get a turn."""
_DROP_LOG_PERIOD_S = 1.0


class EntityHandler(ABC):
    """An entity and the eventfd that is signaled when it has data."""

    entity: Any
    kind: ClassVar[EntityKind]
    waits_for_group = True
    is_awaited = False
    unshared_sources: Sequence[EventSource] = ()
    """Further event sources that only one worker watches, even if several watch the handler."""

    def __init__(self, entity: Any, executor: ExecutorReference) -> None:
        """Keep the entity alive until `close`.

        Args:
            entity: an rclpy entity.
            executor: runs futures and coroutines of the entity's callbacks.

        Raises:
            InvalidHandle: the entity is already destroyed.
        """
        self.entity = entity
        self.group = entity.callback_group
        self.is_shared = False
        """Whether several workers watch it and may run it concurrently."""
        self._executor = executor
        self._handle = self._handle_of(entity)
        self._handle.__enter__()
        self._signal_fd = open_eventfd()

    def enable(self) -> None:
        """Set the listener, and signal once for data that arrived before."""
        set_listener(self.kind, self._handle.pointer, self._signal_fd)
        os.eventfd_write(self._signal_fd, 1)

    def disable(self) -> None:
        """Clear the listener."""
        clear_listener(self.kind, self._handle.pointer)

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The functions that a worker calls, by file descriptor."""
        return {self._signal_fd: partial(self._run, worker)}

    def close(self) -> None:
        """Release the entity; call this after `disable`, when no worker watches it any more."""
        os.close(self._signal_fd)
        self._handle.__exit__(None, None, None)

    @abstractmethod
    def _run(self, worker: Worker) -> bool: ...

    def _handle_of(self, entity: Any) -> Any:
        return entity.handle

    def _requeue(self, worker: Worker, signal_fd: int) -> None:
        """Schedule the remaining data, for this worker's next turn or for another worker."""
        if self.is_shared:
            os.eventfd_write(signal_fd, 1)
        else:
            worker.requeue(signal_fd)

    def _run_task(self, worker: Worker, callback: Callable[..., Any], *args: Any) -> None:
        worker.run_task(Task(callback, args, None, executor=self._executor()), self.group)


class SubscriptionHandler(EntityHandler):
    """Runs the callback for each message: from DDS, this process, or others of the run."""

    kind = EntityKind.SUBSCRIPTION

    def __init__(self, entity: Subscription, executor: ExecutorReference, *, node: Node) -> None:
        """Keep the subscription of `node` alive until `close`."""
        super().__init__(entity, executor)
        self._take = self._handle.take_message
        self._codec = codec_for(entity.msg_type)
        self._callback: Callable[..., Any] | None = None
        self._is_plain = False
        self._next_drop_log_s = -float("inf")
        self._buffer = buffer_of(entity)
        self._topic = intra_process_topic(node.context, self._handle.get_topic_name())
        self._node = node
        self._receiver: LocalReceiver | None = None

    def enable(self) -> None:
        """Set the listener, and open the buffer to publishers in this process and in the run."""
        super().enable()
        if self._buffer is not None:
            # DDS may already hold messages, and later messages must not overtake them.
            self._buffer.mark_dds()
            self._topic.open(self._buffer)
            self._receiver = open_receiver(self._node, self.entity, self._buffer)
            self.unshared_sources = () if self._receiver is None else (self._receiver,)

    def disable(self) -> None:
        """Clear the listener, and close the buffer to publishers."""
        if self._buffer is not None:
            self._topic.close(self._buffer)
        if self._receiver is not None:
            self._receiver.stop()
        super().disable()

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The functions that a worker calls when DDS or the buffer has a message."""
        buffer = self._buffer
        if buffer is None:
            return super().ready_callbacks(worker)
        buffer.wake = buffer.signal if self.is_shared else partial(worker.signal, buffer.signal_fd)
        run_buffered = partial(self._deliver, worker, buffer.take, buffer.signal_fd)
        if self._receiver is not None and not self.is_shared:
            self._receiver.deliver = partial(self._deliver_received, worker, run_buffered)
        return {**super().ready_callbacks(worker), buffer.signal_fd: run_buffered}

    def close(self) -> None:
        """Release the subscription; messages in its buffer stay there for the next handler."""
        if self._buffer is not None:
            self._buffer.wake = self._buffer.signal
        if self._receiver is not None:
            self._receiver.close()
        super().close()

    def _deliver_received(self, worker: Worker, run_buffered: ReadyCallback) -> bool:
        """Deliver messages received from a socket, unless the callback group is blocked."""
        assert self._buffer is not None
        if not worker.is_blocked(self.group):
            return run_buffered()
        self._buffer.wake()
        return False

    def _run(self, worker: Worker) -> bool:
        return self._deliver(worker, self._next, self._signal_fd)

    def _deliver(
        self, worker: Worker, take: Callable[[], tuple[Any, Any] | None], signal_fd: int
    ) -> bool:
        """Run the callback for each available message; `signal_fd` announced them."""
        subscription = self.entity
        ran = False
        for _ in range(_MESSAGES_PER_TURN):
            try:
                taken = take()
            except ObeliskMsgError as error:
                self._log_drop(error)
                continue
            if taken is None:
                return ran
            callback = subscription.callback
            if callback is not self._callback:
                self._inspect(callback)
            if self.is_shared:
                self._requeue(worker, signal_fd)
            if self._is_plain:
                callback(taken[0])
            else:
                self._call(worker, callback, taken)
            ran = True
            if worker.is_interrupted:
                break
        self._requeue(worker, signal_fd)
        return ran

    def _next(self) -> tuple[Any, Any] | None:
        """Take the oldest message; messages in the buffer are older than those in DDS."""
        if self._receiver is not None:
            return self._receiver.take()
        buffer = self._buffer
        if buffer is None:
            return self._take_from_dds()
        taken = buffer.take()
        if taken is None:
            mark = buffer.dds_mark
            taken = self._take_from_dds()
            if taken is None:
                buffer.mark_dds_empty(mark)
        return taken

    def _take_from_dds(self) -> tuple[Any, Any] | None:
        subscription, codec = self.entity, self._codec
        taken: tuple[Any, Any] | None
        if codec is None or subscription.raw:
            taken = self._take(subscription.msg_type, subscription.raw)
            return taken
        taken = self._take(subscription.msg_type, True)
        return None if taken is None else (codec.unpack(taken[0]), taken[1])

    def _log_drop(self, error: ObeliskMsgError) -> None:
        # rclpy throttles per logger object, and `get_logger` returns a new one each time.
        now_s = time.monotonic()
        if now_s >= self._next_drop_log_s:
            self._next_drop_log_s = now_s + _DROP_LOG_PERIOD_S
            text = f"dropped a message on `{self.entity.topic_name}`: {error}"
            get_logger(self.entity.logger_name).error(text)

    def _inspect(self, callback: Callable[..., Any]) -> None:
        """Determine how to call a callback, once instead of for every message."""
        self._callback = callback
        self._is_coroutine = inspect.iscoroutinefunction(callback)
        self._takes_info = self.entity._callback_type is Subscription.CallbackType.WithMessageInfo
        self._is_plain = not (self._is_coroutine or self._takes_info)

    def _call(self, worker: Worker, callback: Callable[..., Any], taken: tuple[Any, Any]) -> None:
        args = taken if self._takes_info else taken[:1]
        if self._is_coroutine:
            self._run_task(worker, callback, *args)
        else:
            callback(*args)


class ServiceHandler(EntityHandler):
    """Responds to requests to a service."""

    kind = EntityKind.SERVICE
    is_awaited = True

    def _run(self, worker: Worker) -> bool:
        service = self.entity
        request, header = self._handle.service_take_request(service.srv_type.Request)
        if header is None:
            return False
        self._requeue(worker, self._signal_fd)
        if inspect.iscoroutinefunction(service.callback):
            self._run_task(worker, self._answer_later, request, header)
        else:
            self._answer(service.callback(request, service.srv_type.Response()), header)
        return True

    async def _answer_later(self, request: Any, header: Any) -> None:
        self._answer(await self.entity.callback(request, self.entity.srv_type.Response()), header)

    def _answer(self, response: Any, header: Any) -> None:
        # If a callback destroyed its own service, the response can no longer be sent.
        with suppress(InvalidHandle):
            self.entity.send_response(response, header)


class ClientHandler(EntityHandler):
    """Completes the futures of requests.

    Taking a response runs no user code, so it does not wait for a suspended coroutine of the
    callback group. That coroutine may be waiting for the response.
    """

    kind = EntityKind.CLIENT
    waits_for_group = False
    is_awaited = True

    def _run(self, worker: Worker) -> bool:
        client = self.entity
        header, response = self._handle.take_response(client.srv_type.Response)
        if header is None:
            return False
        self._requeue(worker, self._signal_fd)
        # A canceled request is no longer pending.
        with suppress(KeyError):
            future = client.get_pending_request(header.request_id.sequence_number)
            future._set_executor(self._executor())
            future.set_result(response)
        return True


class QosEventHandler(EntityHandler):
    """Runs the callback for QoS events, such as an incompatible publisher.

    In a wait set, these events would cause a wake-up for every message of their subscription.
    """

    kind = EntityKind.EVENT

    def enable(self) -> None:
        """Set the listener; the middleware then also reports earlier events."""
        set_listener(self.kind, self._handle.pointer, self._signal_fd)

    def _handle_of(self, entity: Any) -> Any:
        # rclpy exposes the event only to its own wait set.
        return entity._EventHandler__event

    def _run(self, worker: Worker) -> bool:
        try:
            os.eventfd_read(self._signal_fd)
        except BlockingIOError:  # taken by another worker
            return False
        event = self._handle.take_event()
        if not event:
            return False
        callback = self.entity.callback
        if inspect.iscoroutinefunction(callback):
            self._run_task(worker, callback, event)
        else:
            callback(event)
        return True


class TimerCallbackHandler(EntityHandler):
    """A timer; the base class's eventfd is signaled when the timer is reset."""

    kind = EntityKind.TIMER_RESET

    def __init__(self, entity: Timer, executor: ExecutorReference) -> None:
        super().__init__(entity, executor)
        self._callback: Callable[[], Any] | None = None

    def _call(self, worker: Worker) -> None:
        callback = self.entity.callback
        if callback is not self._callback:
            self._callback = callback
            self._is_coroutine = inspect.iscoroutinefunction(callback)
        if self._is_coroutine:
            self._run_task(worker, callback)
        else:
            callback()


class TimerHandler(TimerCallbackHandler):
    """Runs a timer's callback once per period, scheduled by a kernel timer.

    The kernel timer is set to the rcl timer's next call and period. It is set again when the rcl
    timer is reset, canceled or given another period, and when a message on `/clock` changes the
    simulated time.
    """

    def __init__(self, entity: Timer, executor: ExecutorReference) -> None:
        super().__init__(entity, executor)
        clock = entity.clock
        steady = clock.clock_type == ClockType.STEADY_TIME
        self._kernel_clock = time.CLOCK_MONOTONIC if steady else time.CLOCK_REALTIME
        self._ros_clock = clock if clock.clock_type == ClockType.ROS_TIME else None
        self._timer_fd = open_timer(self._kernel_clock)
        self._arming = threading.Lock()
        self._is_closed = False
        self._period_ns = 0
        self._wakeup = EarlyWakeup()
        self._jump = self._ros_clock and self._ros_clock.create_jump_callback(
            _ANY_JUMP, post_callback=lambda _jump: self._arm()
        )

    def enable(self) -> None:
        """Set the listener and the kernel timer."""
        super().enable()
        self._arm()

    def ready_callbacks(self, worker: Worker) -> Mapping[int, ReadyCallback]:
        """The functions that a worker calls when the timer is due and when it was reset."""
        return {self._timer_fd: partial(self._run, worker), self._signal_fd: self._follow}

    def close(self) -> None:
        """Release the timer, its clock and the kernel timer."""
        if self._jump is not None:
            self._jump.unregister()
        with self._arming:
            self._is_closed = True
            os.close(self._timer_fd)
        super().close()

    def _follow(self) -> bool:
        self._arm()
        return False

    def _arm(self) -> None:
        """Set the kernel timer to the rcl timer's current schedule."""
        with self._arming:
            if self._is_closed:
                return
            self._period_ns = self._handle.get_timer_period()
            left_ns = self._handle.time_until_next_call()
            is_simulated = self._ros_clock is not None and self._ros_clock.ros_time_is_active
            period_ns = 0 if left_ns is None or is_simulated else self._period_ns
            lead_ns = self._wakeup.renew(period_ns)
            if left_ns is None:  # canceled
                first_ns = 0
            elif is_simulated:
                # Run now if due, otherwise check again when the time changes.
                first_ns = _IMMEDIATELY_NS if left_ns <= 0 else 0
            else:
                # Read the clock after `left_ns`, so that the timer does not expire too early.
                now_ns = time.clock_gettime_ns(self._kernel_clock)
                first_ns = max(now_ns + left_ns - lead_ns, _IMMEDIATELY_NS)
            arm_timer(self._timer_fd, first_ns, period_ns)

    def _run(self, worker: Worker) -> bool:
        try:
            os.read(self._timer_fd, 8)  # acknowledges the expiry
        except BlockingIOError:
            return False  # set again in the meantime, or handled by another worker
        handle = self._handle
        left_ns = handle.time_until_next_call()
        if left_ns is None or left_ns > self._wakeup.lead_ns:
            return self._follow()  # canceled, or due later than when the kernel timer was set
        self._wakeup.wait(left_ns, worker.waiting_since_ns)
        if not handle.is_timer_ready():
            return self._follow()  # another thread has reset it in the meantime
        try:
            handle.call_timer()
        except RCLError:  # another thread has just canceled it
            return self._follow()
        self._call(worker)
        period_ns = handle.get_timer_period()
        # The kernel repeats no timer with the period 0, which rcl calls whenever it can.
        if not period_ns or self._wakeup.is_outdated or period_ns != self._period_ns:
            self._arm()
        return True
