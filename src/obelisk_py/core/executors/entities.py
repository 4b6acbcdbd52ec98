"""Runners of subscriptions, services, clients and events: what is done with what has arrived.

A runner keeps its entity's rcl structure alive and listens to it with one eventfd. Its handler
takes what is there and calls the user; it leaves off after any callback during which the lane was
called upon, because that callback may have destroyed the entity.
"""

import inspect
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar

from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.logging import get_logger
from rclpy.subscription import Subscription
from rclpy.task import Task

from obelisk_py.core.exceptions import ObeliskMsgError
from obelisk_py.core.executors.lane import Handler, Lane
from obelisk_py.core.executors.listeners import EntityKind, open_signal, signal_off, signal_on
from obelisk_py.core.local_delivery.exchange import inbox_of, local_topic
from obelisk_py.core.serialization.codec import codec_for

__all__ = ["ClientRunner", "EventRunner", "Runner", "ServiceRunner", "SubscriptionRunner"]

ExecutorReference = Callable[[], Executor | None]

# Then the others get a turn, however many messages are waiting.
_MESSAGES_PER_TURN = 32
_DROPS_TOLD_EVERY_S = 1.0


class Runner(ABC):
    """An entity with the eventfd that says that it has something to take."""

    entity: Any
    kind: ClassVar[EntityKind]
    waits_for_group = True

    def __init__(self, entity: Any, executor: ExecutorReference) -> None:
        """Keep the entity from being destroyed until `close`.

        Args:
            entity: of rclpy.
            executor: for futures and coroutines that the entity's callbacks make.

        Raises:
            InvalidHandle: it is destroyed already.
        """
        self.entity = entity
        self.group = entity.callback_group
        self.is_shared = False
        """Watched by several lanes, which may run it at the same time."""
        self._executor = executor
        self._handle = self._handle_of(entity)
        self._handle.__enter__()
        self._signal_fd = open_signal()

    def listen(self) -> None:
        """Begin to be signalled, at once for what came before."""
        signal_on(self.kind, self._handle.pointer, self._signal_fd)
        os.eventfd_write(self._signal_fd, 1)

    def silence(self) -> None:
        """Be signalled no longer."""
        signal_off(self.kind, self._handle.pointer)

    def handlers(self, lane: Lane) -> Mapping[int, Handler]:
        """What a lane calls, by descriptor."""
        return {self._signal_fd: partial(self._run, lane)}

    def close(self) -> None:
        """Let go of the entity, once silenced and watched by no lane."""
        os.close(self._signal_fd)
        self._handle.__exit__(None, None, None)

    @abstractmethod
    def _run(self, lane: Lane) -> bool: ...

    def _handle_of(self, entity: Any) -> Any:
        return entity.handle

    def _more(self, lane: Lane, signal_fd: int) -> None:
        """See to it that what may be left is taken: later, or meanwhile by another lane."""
        if self.is_shared:
            os.eventfd_write(signal_fd, 1)
        else:
            lane.again(signal_fd)

    def _begin(self, lane: Lane, callback: Callable[..., Any], *args: Any) -> None:
        lane.begin(Task(callback, args, None, executor=self._executor()), self.group)


class SubscriptionRunner(Runner):
    """Calls the user with each message, from DDS or from a publisher of this process."""

    kind = EntityKind.SUBSCRIPTION

    def __init__(
        self, entity: Subscription, executor: ExecutorReference, *, context: Context
    ) -> None:
        """As the base; `context` is that of the subscription's node."""
        super().__init__(entity, executor)
        self._take = self._handle.take_message
        self._codec = codec_for(entity.msg_type)
        self._callback: Callable[..., Any] | None = None
        self._is_plain = False
        self._next_drop_told_s = -float("inf")
        self._inbox = inbox_of(entity)
        self._local_topic = local_topic(context, self._handle.get_topic_name())

    def listen(self) -> None:
        """Begin to be signalled, by DDS and by publishers of this process."""
        super().listen()
        if self._inbox is not None:
            # DDS may hold messages already, which none may overtake.
            self._inbox.mark_dds()
            self._local_topic.open(self._inbox)

    def silence(self) -> None:
        """Be signalled no longer."""
        if self._inbox is not None:
            self._local_topic.close(self._inbox)
        super().silence()

    def handlers(self, lane: Lane) -> Mapping[int, Handler]:
        """What a lane calls when there is something in DDS, and when there is in the inbox."""
        inbox = self._inbox
        if inbox is None:
            return super().handlers(lane)
        inbox.wake = inbox.signal if self.is_shared else partial(lane.signal, inbox.signal_fd)
        run_local = partial(self._deliver, lane, inbox.take, inbox.signal_fd)
        return {**super().handlers(lane), inbox.signal_fd: run_local}

    def close(self) -> None:
        """Let go of the subscription; what is in its inbox waits for the next runner."""
        if self._inbox is not None:
            self._inbox.wake = self._inbox.signal
        super().close()

    def _run(self, lane: Lane) -> bool:
        return self._deliver(lane, self._next, self._signal_fd)

    def _deliver(
        self, lane: Lane, take: Callable[[], tuple[Any, Any] | None], signal_fd: int
    ) -> bool:
        """Call the user with what there is to take, which `signal_fd` told of."""
        subscription = self.entity
        ran = False
        for _ in range(_MESSAGES_PER_TURN):
            try:
                taken = take()
            except ObeliskMsgError as error:
                self._tell_of_drop(error)
                continue
            if taken is None:
                return ran
            callback = subscription.callback
            if callback is not self._callback:
                self._learn(callback)
            if self.is_shared:
                self._more(lane, signal_fd)
            if self._is_plain:
                callback(taken[0])
            else:
                self._call(lane, callback, taken)
            ran = True
            if lane.attention:
                break
        self._more(lane, signal_fd)
        return ran

    def _next(self) -> tuple[Any, Any] | None:
        """The oldest message: what is in the inbox was published before what is in DDS."""
        inbox = self._inbox
        if inbox is None:
            return self._take_from_dds()
        taken = inbox.take()
        if taken is None:
            mark = inbox.dds_mark
            taken = self._take_from_dds()
            if taken is None:
                inbox.mark_dds_empty(mark)
        return taken

    def _take_from_dds(self) -> tuple[Any, Any] | None:
        subscription, codec = self.entity, self._codec
        taken: tuple[Any, Any] | None
        if codec is None or subscription.raw:
            taken = self._take(subscription.msg_type, subscription.raw)
            return taken
        taken = self._take(subscription.msg_type, True)
        return None if taken is None else (codec.unpack(taken[0]), taken[1])

    def _tell_of_drop(self, error: ObeliskMsgError) -> None:
        # Middleware that unpacks drops what it cannot read as well, but says nothing.
        # rclpy's throttle goes with a logger, and `get_logger` makes a new one each time.
        now_s = time.monotonic()
        if now_s >= self._next_drop_told_s:
            self._next_drop_told_s = now_s + _DROPS_TOLD_EVERY_S
            text = f"dropped a message on `{self.entity.topic_name}`: {error}"
            get_logger(self.entity.logger_name).error(text)

    def _learn(self, callback: Callable[..., Any]) -> None:
        """What can be told of a callback once instead of at every message."""
        self._callback = callback
        self._is_coroutine = inspect.iscoroutinefunction(callback)
        self._takes_info = self.entity._callback_type is Subscription.CallbackType.WithMessageInfo
        self._is_plain = not (self._is_coroutine or self._takes_info)

    def _call(self, lane: Lane, callback: Callable[..., Any], taken: tuple[Any, Any]) -> None:
        args = taken if self._takes_info else taken[:1]
        if self._is_coroutine:
            self._begin(lane, callback, *args)
        else:
            callback(*args)


class ServiceRunner(Runner):
    """Answers requests."""

    kind = EntityKind.SERVICE

    def _run(self, lane: Lane) -> bool:
        service = self.entity
        request, header = self._handle.service_take_request(service.srv_type.Request)
        if header is None:
            return False
        self._more(lane, self._signal_fd)
        if inspect.iscoroutinefunction(service.callback):
            self._begin(lane, self._answer_later, request, header)
        else:
            self._answer(service.callback(request, service.srv_type.Response()), header)
        return True

    async def _answer_later(self, request: Any, header: Any) -> None:
        self._answer(await self.entity.callback(request, self.entity.srv_type.Response()), header)

    def _answer(self, response: Any, header: Any) -> None:
        # A callback that destroys its own service has no way left to answer.
        with suppress(InvalidHandle):
            self.entity.send_response(response, header)


class ClientRunner(Runner):
    """Completes the futures of requests.

    A response calls no code of the user, so it is let through while a coroutine of the group is
    suspended; that coroutine may well be what waits for it.
    """

    kind = EntityKind.CLIENT
    waits_for_group = False

    def _run(self, lane: Lane) -> bool:
        client = self.entity
        header, response = self._handle.take_response(client.srv_type.Response)
        if header is None:
            return False
        self._more(lane, self._signal_fd)
        # A request that was cancelled is not pending any more.
        with suppress(KeyError):
            future = client.get_pending_request(header.request_id.sequence_number)
            future._set_executor(self._executor())
            future.set_result(response)
        return True


class EventRunner(Runner):
    """Tells the user of quality-of-service events, as of a publisher that does not fit.

    In a wait set these would wake it at every message of their subscription.
    """

    kind = EntityKind.EVENT

    def listen(self) -> None:
        """Begin to be signalled; the middleware tells of what came before."""
        signal_on(self.kind, self._handle.pointer, self._signal_fd)

    def _handle_of(self, entity: Any) -> Any:
        # rclpy shows it to nobody but the wait set.
        return entity._EventHandler__event

    def _run(self, lane: Lane) -> bool:
        try:
            os.eventfd_read(self._signal_fd)
        except BlockingIOError:  # taken by another lane
            return False
        event = self._handle.take_event()
        if not event:
            return False
        callback = self.entity.callback
        if inspect.iscoroutinefunction(callback):
            self._begin(lane, callback, event)
        else:
            callback(event)
        return True
