"""The services of life-cycle nodes as their clients: made once, asked without waiting.

A request to a node that dies is never answered; what is kept for it here is dropped.
"""

import threading
import time
from collections import defaultdict, deque
from typing import Any, Final

__all__ = ["NodeClients"]

PING_S: Final = 3.0
"""After which the answer to a question for a state is given up [s]."""


class NodeClients:
    """Service clients by node; every method may be called from any thread and returns at once."""

    def __init__(self, node: Any) -> None:
        """Begin without any client.

        Args:
            node: of rclpy, that asks.
        """
        from lifecycle_msgs.srv import ChangeState, GetState
        from std_srvs.srv import Trigger

        self._node = node
        self._types = {"change_state": ChangeState, "get_state": GetState, "last_error": Trigger}
        self._clients: dict[tuple[str, str], Any] = {}
        self._pings: defaultdict[str, deque[tuple[float, Any]]] = defaultdict(deque)
        self._lock = threading.Lock()

    def open(self, node: str) -> None:
        """Make the clients of a node, so that they find their services from now on."""
        # In the order in which nodes offer them, and DDS tells of them in order: whoever answers
        # for its state has been told of `change_state` as well.
        for service in self._types:
            self._client(node, service)

    def is_ready(self, node: str, service: str) -> bool:
        """Whether there is a server; one that was killed counts until its lease ends."""
        return bool(self._client(node, service).service_is_ready())

    def ask_state(self, node: str) -> Any:
        """A future of the node's state; dropped, with its callbacks, when no answer comes."""
        client = self._client(node, "get_state")
        now = time.monotonic()
        with self._lock:
            pings = self._pings[node]
            while pings and (pings[0][0] < now - PING_S or pings[0][1].done()):
                client.remove_pending_request(pings.popleft()[1])
            future = client.call_async(self._types["get_state"].Request())
            pings.append((now, future))
        return future

    def ask_fault(self, node: str) -> Any:
        """A future of the node's words on its newest fault."""
        return self._client(node, "last_error").call_async(self._types["last_error"].Request())

    def change_state(self, node: str, transition: str) -> Any:
        """A future of how the node's transition ended."""
        request = self._types["change_state"].Request()
        # By name: the number of `shutdown` depends on the state, and an unknown number kills
        # nodes of plain rclpy.
        request.transition.label = transition
        return self._client(node, "change_state").call_async(request)

    def _client(self, node: str, service: str) -> Any:
        with self._lock:
            if (node, service) not in self._clients:
                self._clients[node, service] = self._node.create_client(
                    self._types[service], f"{node}/{service}"
                )
            return self._clients[node, service]
