"""Call services from a bare participant: send, then poll until a deadline.

A node that dies never responds, and the response of one that has not discovered the client yet is
lost. So requests are sent again, and a first one is sent before anything else.
"""

import time
from contextlib import suppress
from typing import Any, Final

from obk_cli.errors import CommandFailedError
from obk_cli.ros.participant import RosParticipant
from obk_cli.ros.types import find_type, require_service

__all__ = ["ServiceClient"]

POLL_S: Final = 0.001
ASK_AGAIN_S: Final = 0.5
"""The first answer to a client is lost if the node has not discovered the client by then [s]."""
KNOWN_S: Final = 2.0
"""For a node to be found and to answer that it knows a client; it may have no time for that [s]."""
QUESTIONS: Final = {
    "get_parameters": "rcl_interfaces/srv/GetParameters",
    "get_state": "lifecycle_msgs/srv/GetState",
}
"""Services that most nodes have, and that change nothing."""


class ServiceClient:
    """One service's client."""

    def __init__(self, participant: RosParticipant, name: str, python_type: Any) -> None:
        """Make the client.

        Args:
            participant: whose participant asks.
            name: full, of the service.
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
        """The response to a request.

        Args:
            request: of the service's class.
            timeout_s: for the server and its response [s].
            is_question: whether it changes nothing, so that it may be asked again and again.

        Raises:
            CommandFailedError: none came in time, or there is no server.
        """
        end = time.monotonic() + timeout_s
        is_there = self._participant.wait_for(
            lambda: self._client.service_server_is_available() or None, timeout_s
        )
        if is_there is None:
            raise CommandFailedError(f"no node serves {self._name} within {timeout_s:g} s")
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
            f"{self._name} gave no answer within {timeout_s:g} s",
            help="its node may hang; `obk lifecycle get` asks for its state",
        )

    def _wait_until_discovered(self, end: float) -> None:
        """Wait until the server's node has discovered this client, as far as it can be checked.

        Nodes discover clients in order: one that answers a later client knows this one too.
        """
        until = min(end, time.monotonic() + KNOWN_S)
        # A service may be found before its node's name is.
        node = self._participant.wait_for(self._node, until - time.monotonic())
        there = {} if node is None else self._participant.services_of(node)
        asked = (s for s, kind in QUESTIONS.items() if kind in there.get(f"{node}/{s}", ()))
        service = next(asked, None)
        if service is None or f"{node}/{service}" == self._name:
            return
        with suppress(CommandFailedError):
            kind = find_type(QUESTIONS[service])
            client = ServiceClient(self._participant, f"{node}/{service}", kind)
            client.call(kind.Request(), until - time.monotonic(), is_question=True)

    def _node(self) -> str | None:
        """The full name of the server's node, once it is discovered."""
        participant = self._participant
        return next(
            (node for node in participant.nodes() if self._name in participant.services_of(node)),
            None,
        )
