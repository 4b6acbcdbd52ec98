"""Run actions in lockstep: rclpy's servers and clients with a different message transport.

rclpy's `ActionServer` and `ActionClient` manage the goals. They pass requests, responses, feedback
and status to a C handle. In lockstep, the classes here replace this handle. They keep the same
state about goals as the C code, and pass messages to their counterparts as events.
"""

import functools
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.impl.implementation_singleton import rclpy_implementation

from obelisk_py.core.lockstep.scheduler import MESSAGE, ScheduledNode, Scheduler
from obelisk_py.core.lockstep.tasks import LockstepExecutor

__all__ = ["ActionTable", "lockstep_actions"]


class ActionTable:
    """The action servers and clients of a run, by full name."""

    def __init__(self, scheduler: Scheduler) -> None:
        """Create an empty table."""
        self.scheduler = scheduler
        self.servers: dict[str, ServerHandle] = {}
        self.clients: dict[str, list[ClientHandle]] = {}

    def remove(self, handle: "_Handle") -> None:
        """Remove a server or client."""
        self._keep(lambda each: each is not handle)

    def leave(self, node: ScheduledNode) -> None:
        """Remove a node's servers and clients."""
        self._keep(lambda each: each.owner is not node)

    def _keep(self, is_kept: "Callable[[_Handle], bool]") -> None:
        self.servers = {name: each for name, each in self.servers.items() if is_kept(each)}
        for name, clients in self.clients.items():
            self.clients[name] = [each for each in clients if is_kept(each)]


@contextmanager
def lockstep_actions(table: ActionTable) -> Iterator[None]:
    """Inside the `with` block, new action servers and clients register in this table."""
    before = rclpy_implementation.ActionServer, rclpy_implementation.ActionClient
    rclpy_implementation.ActionServer = functools.partial(ServerHandle, table)
    rclpy_implementation.ActionClient = functools.partial(ClientHandle, table)
    try:
        yield
    finally:
        rclpy_implementation.ActionServer, rclpy_implementation.ActionClient = before


class _Inbox:
    """Messages received for a handle, by kind, until rclpy takes them."""

    def __init__(self, *kinds: str) -> None:
        self._queues: dict[str, deque[Any]] = {kind: deque() for kind in kinds}

    def put(self, kind: str, item: Any) -> None:
        self._queues[kind].append(item)

    def take(self, kind: str, nothing: Any) -> Any:
        queue = self._queues[kind]
        return queue.popleft() if queue else nothing

    def ready(self) -> tuple[bool, ...]:
        return tuple(bool(queue) for queue in self._queues.values())


class _Handle:
    """A handle whose received messages reach rclpy in an event."""

    table: ActionTable
    owner: ScheduledNode
    waitable: Any
    inbox: _Inbox
    name: str

    def attach(self, owner: ScheduledNode, waitable: Any) -> None:
        """Set the node and the rclpy object that own this handle."""
        self.owner, self.waitable = owner, waitable

    def receive(self, kind: str, item: Any) -> None:
        """Deliver a message after its latency, in an event of the node."""
        scheduler = self.table.scheduler
        due_ns = scheduler.time_ns + scheduler.delay_ns(self.name)
        arrive = functools.partial(self._arrive, kind, item)
        scheduler.push(due_ns, MESSAGE, self.owner, arrive)

    def destroy_when_not_in_use(self) -> None:
        """Remove the handle from the table; called by rclpy's `destroy`."""
        self.table.remove(self)
        super().destroy_when_not_in_use()  # type: ignore[misc]

    def _arrive(self, kind: str, item: Any) -> None:
        self.inbox.put(kind, item)
        waitable, executor = self.waitable, self.owner.node.executor
        assert isinstance(executor, LockstepExecutor)
        if waitable.is_ready(None):
            executor.run_coroutine(waitable.execute(waitable.take_data()), self.owner)


class ServerHandle(_Handle, rclpy_implementation.ActionServer):  # type: ignore[misc]
    """The handle of an action server."""

    def __init__(self, table: ActionTable, node: Any, clock: Any, kind: Any, name: str, *qos: Any):
        """Create the handle; rclpy passes all arguments except the table."""
        super().__init__(node, clock, kind, name, *qos)
        self.table = table
        self.inbox = _Inbox("goal", "cancel", "result")
        self.action_type = kind
        self.name = rclpy_implementation.rclpy_resolve_name(node, name, False, True)
        table.servers[self.name] = self

    def is_ready(self, _wait_set: Any) -> tuple[bool, ...]:
        return (*self.inbox.ready(), False)

    def take_goal_request(self, _kind: Any) -> Any:
        return self.inbox.take("goal", (None, None))

    def take_cancel_request(self, _kind: Any) -> Any:
        return self.inbox.take("cancel", (None, None))

    def take_result_request(self, _kind: Any) -> Any:
        return self.inbox.take("result", (None, None))

    def send_goal_response(self, header: "_Request", response: Any) -> None:
        header.answer("goal", response)

    def send_cancel_response(self, header: "_Request", response: Any) -> None:
        header.answer("cancel", response)

    def send_result_response(self, header: "_Request", response: Any) -> None:
        header.answer("result", response)

    def publish_feedback(self, message: Any) -> None:
        self._publish("feedback", message)

    def publish_status(self) -> None:
        message = self.action_type.Impl.GoalStatusMessage()
        for goal in self.waitable._goal_handles.values():
            if (handle := goal._goal_handle) is None:
                continue  # destroyed
            # Not `goal.status`, whose lock is held while its state changes.
            status = GoalStatus(status=handle.get_status())
            status.goal_info = goal._goal_info
            message.status_list.append(status)
        self._publish("status", message)

    def expire_goals(self, _count: int) -> tuple[()]:
        return ()

    def _publish(self, kind: str, message: Any) -> None:
        for client in self.table.clients.get(self.name, ()):
            client.receive(kind, message)


class _Request:
    """The destination of a response; rclpy passes it back with the response."""

    def __init__(self, client: "ClientHandle", sequence: int) -> None:
        self._client, self._sequence = client, sequence

    def answer(self, kind: str, response: Any) -> None:
        self._client.receive(kind, (self._sequence, response))


class ClientHandle(_Handle, rclpy_implementation.ActionClient):  # type: ignore[misc]
    """The handle of an action client."""

    def __init__(self, table: ActionTable, node: Any, kind: Any, name: str, *qos: Any) -> None:
        """Create the handle; rclpy passes all arguments except the table."""
        super().__init__(node, kind, name, *qos)
        self.table = table
        self.inbox = _Inbox("feedback", "status", "goal", "cancel", "result")
        self.name = rclpy_implementation.rclpy_resolve_name(node, name, False, True)
        self._sequence = 0
        table.clients.setdefault(self.name, []).append(self)

    def is_ready(self, _wait_set: Any) -> tuple[bool, ...]:
        return self.inbox.ready()

    def is_action_server_available(self) -> bool:
        return self.name in self.table.servers

    def send_goal_request(self, request: Any) -> int:
        return self._send("goal", request)

    def send_cancel_request(self, request: Any) -> int:
        return self._send("cancel", request)

    def send_result_request(self, request: Any) -> int:
        return self._send("result", request)

    def take_goal_response(self, _kind: Any) -> Any:
        return self.inbox.take("goal", (None, None))

    def take_cancel_response(self, _kind: Any) -> Any:
        return self.inbox.take("cancel", (None, None))

    def take_result_response(self, _kind: Any) -> Any:
        return self.inbox.take("result", (None, None))

    def take_feedback(self, _kind: Any) -> Any:
        return self.inbox.take("feedback", None)

    def take_status(self, _kind: Any) -> Any:
        return self.inbox.take("status", None)

    def _send(self, kind: str, request: Any) -> int:
        self._sequence += 1
        server = self.table.servers.get(self.name)
        if server is None:
            self.table.scheduler.note(
                ("action", self.name), f"no node serves the action {self.name}"
            )
        else:
            server.receive(kind, (_Request(self, self._sequence), request))
        return self._sequence
