"""Call services from a bare participant: send a request, then poll until a time limit.

A node that dies never responds, and the response of a node that has not discovered the client yet
is lost. Requests are therefore repeated, and a harmless one is sent first.
"""

import time
from contextlib import suppress
from typing import Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.types import find_type, require_service

__all__ = ["ASK_AGAIN_S", "ServiceClient"]

POLL_S: Final = 0.001
ASK_AGAIN_S: Final = 0.5
"""Repeat interval; the answer is lost if the node has not discovered the client yet [s]."""
KNOWN_S: Final = 2.0
"""Limit for a node to discover a client and answer; it may be too busy for that [s]."""
QUESTIONS: Final = {
    "get_parameters": "rcl_interfaces/srv/GetParameters",
    "get_state": "lifecycle_msgs/srv/GetState",
}
"""Services that most nodes have, and that change nothing."""


class ServiceClient:
    """The client of one service."""

    def __init__(self, participant: RosParticipant, name: str, python_type: Any) -> None:
        """Create the client.

        Args:
            participant: the participant that sends requests.
            name: full name of the service.
            python_type: the service's class.

        Raises:
            CommandFailedError: such services cannot be called here.
        """
        from rclpy.impl.implementation_singleton import rclpy_implementation
        from rclpy.qos import qos_profile_services_default

        require_service(python_type)
        self._name = name
        self._type = python_type
        self._participant = participant
        profile: Any = qos_profile_services_default
        with participant.node:
            self._client: Any = rclpy_implementation.Client(
                participant.node, python_type, name, profile.get_c_qos_profile()
            )

    def call(self, request: Any, timeout_s: float, *, is_question: bool = False) -> Any:
        """Send a request and return the response.

        Args:
            request: of the service's class.
            timeout_s: limit for finding the server and for its response [s].
            is_question: whether it changes nothing, so that it may be repeated.

        Raises:
            CommandFailedError: no server exists, or no response arrives in time.
        """
        end = time.monotonic() + timeout_s
        is_there = self._participant.wait_for(
            lambda: self._client.service_server_is_available() or None, timeout_s
        )
        if is_there is None:
            raise CommandFailedError(f"no node offered {self._name} within {timeout_s:g} s")
        if not is_question:
            self._wait_until_discovered(end)
        numbers = {self._client.send_request(request)}
        again = time.monotonic() + ASK_AGAIN_S
        while (now := time.monotonic()) < end:
            header, response = self._client.take_response(self._type.Response)
            if header is not None and header.request_id.sequence_number in numbers:
                return response
            if is_question and now > again:
                numbers.add(self._client.send_request(request))
                again = now + ASK_AGAIN_S
            time.sleep(POLL_S)
        raise CommandFailedError(
            f"{self._name} did not answer within {timeout_s:g} s",
            help="its node may hang; check its state with `obk lifecycle get`",
        )

    def _wait_until_discovered(self, end: float) -> None:
        """Wait until the server's node has discovered this client, as far as that can be checked.

        Nodes discover clients in order: a node that answers a later client also knows this one.
        """
        until = min(end, time.monotonic() + KNOWN_S)
        # A service may be discovered before the name of its node.
        node = self._participant.wait_for(self._node, until - time.monotonic())
        there = {} if node is None else self._participant.services_of(node)
        names = (s for s, kind in QUESTIONS.items() if kind in there.get(f"{node}/{s}", ()))
        service = next(names, None)
        if service is None or f"{node}/{service}" == self._name:
            return
        with suppress(CommandFailedError):
            kind = find_type(QUESTIONS[service])
            client = ServiceClient(self._participant, f"{node}/{service}", kind)
            client.call(kind.Request(), until - time.monotonic(), is_question=True)

    def _node(self) -> str | None:
        """The full name of the server's node; None until it is discovered."""
        participant = self._participant
        return next(
            (node for node in participant.nodes() if self._name in participant.services_of(node)),
            None,
        )
