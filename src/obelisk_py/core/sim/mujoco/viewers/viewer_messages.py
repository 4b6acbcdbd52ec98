"""The link from a simulation to a viewer (states, reports) and back (messages, requests).

On the robot's side, each `send` sends one packet with MuJoCo's flat state vector. It never blocks:
if there is no space, the state is dropped and counted. On the viewer's side, `data` of the same
model is set to the received state. Times in the states are simulated time. The robot also sends
reports (`viewer_requests`), on a thread that may wait.

The link is a pair of SOCK_SEQPACKET sockets: packets stay whole and in order, and each side detects
when the other one ends, even by a crash.

Source: https://mujoco.readthedocs.io/en/stable/computation/index.html#the-state
"""

import errno
import json
import select
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Final, Literal, Self, cast

import mujoco
import numpy as np

__all__ = [
    "EXIT_REPORTED",
    "SIGNATURE",
    "TOKEN_VARIABLE",
    "MessageKind",
    "Notify",
    "Send",
    "Severity",
    "StateSender",
    "States",
    "VideoJob",
    "receive_message",
    "send_message",
    "send_report",
]

Severity = Literal["info", "warning"]
Notify = Callable[[Severity, str], None]
"""Called with a message for the user."""
MessageKind = Literal["info", "warning", "page", "request"]
"""A message for the user, the URL of the viewer's page, or a request to the robot."""
Send = Callable[[MessageKind, str], None]
"""Sends a message of a viewer to the robot."""

EXIT_REPORTED: Final = 3
"""Exit code of a viewer that has reported why it ends."""
TOKEN_VARIABLE: Final = "OBK_VIEWER_TOKEN"  # noqa: S105 - the name of a variable, no secret
"""The environment variable with the token of the page; command lines are readable by all users."""
_LARGEST: Final = 8192
"""Maximum size of a message packet; longer messages are truncated [bytes]."""
_SEPARATOR: Final = b":"
_STATE_MARK: Final = 0.0
"""First number of a packet with a state; no report begins with its bytes, which are zero."""
_REPORT_S: Final = 1.0
"""How long a report waits for space [s]; a working viewer reads from the link continuously."""
SIGNATURE: Final = int(
    mujoco.mjtState.mjSTATE_FULLPHYSICS
    | mujoco.mjtState.mjSTATE_USER
    | mujoco.mjtState.mjSTATE_WARMSTART
)
"""The full input of a step (mjSTATE_INTEGRATION), so viewers can also draw what depends on it."""


def send_message(link: socket.socket, kind: MessageKind, text: str) -> None:
    """Send a message to the robot.

    Raises:
        OSError: the other side is closed.
    """
    link.send(kind.encode() + _SEPARATOR + text.encode()[: _LARGEST // 2])


def send_report(link: socket.socket, text: str) -> None:
    """Send a report to a viewer, unless it exits or does not take packets for a second."""
    poll = select.poll()
    poll.register(link, select.POLLOUT)
    poll.poll(_REPORT_S * 1000)
    with suppress(OSError):
        link.send(text.encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)


def receive_message(link: socket.socket) -> tuple[MessageKind, str] | None:
    """Wait for a message; None if there will be no more."""
    try:
        packet = link.recv(_LARGEST)
    # A process that ends with unread packets resets the link. Linux reports this before the last
    # messages are read.
    except ConnectionResetError:
        packet = link.recv(_LARGEST)
    if not packet:
        return None
    kind, _, text = packet.partition(_SEPARATOR)
    return cast(MessageKind, kind.decode()), text.decode(errors="replace")


class StateSender:
    """The robot's end of the link; for the stepping thread."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, link: socket.socket, notify: Notify
    ) -> None:
        """Send states of `data` to `link`.

        Args:
            model: the model.
            data: its state; read by `send` and never changed.
            link: one end of a SOCK_SEQPACKET pair.
            notify: called once if sending fails.
        """
        self.sent = 0
        """Number of states sent."""
        self.dropped = 0
        """Number of states dropped because the viewer had not received the earlier ones."""
        self._model = model
        self._data = data
        self._link = link
        self._notify = notify
        self._packet = np.full(1 + mujoco.mj_stateSize(model, SIGNATURE), _STATE_MARK)
        self._state = self._packet[1:]
        self._is_open = True

    def send(self) -> None:
        """Send the current state, if there is space and the viewer is alive."""
        if not self._is_open:
            return
        mujoco.mj_getState(self._model, self._data, self._state, SIGNATURE)
        try:
            self._link.send(self._packet.data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except BlockingIOError:
            self.dropped += 1
        except OSError as error:
            self._is_open = False
            # `ViewerProcess` reports that the viewer has ended.
            if error.errno == errno.EMSGSIZE:
                self._notify("warning", self._too_large())
        else:
            self.sent += 1

    def _too_large(self) -> str:
        room = self._link.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        return (
            f"a state of this model has {self._packet.nbytes} bytes, but a socket on this machine "
            f"accepts at most {room} at once, so no state is shown; fix: "
            f"`sysctl -w net.core.wmem_max={2 * self._packet.nbytes}`"
        )


class States:
    """The viewer's end of the link: the model, and its data at the last received state."""

    def __init__(self, model: mujoco.MjModel, link: socket.socket) -> None:
        """Receive states from `link`; until the first one, `data` has the model's initial state."""
        self.model = model
        self.data = mujoco.MjData(model)
        self.is_over = False
        """Whether the robot process has ended and every state was received."""
        self.reports: list[str] = []
        """Reports of the robot so far; a viewer removes those that it has read."""
        self._link = link
        self._size = mujoco.mj_stateSize(model, SIGNATURE)
        self._packet = bytearray(max(_LARGEST, 8 * (1 + self._size)))
        """The latest state."""
        self._next_packet = bytearray(len(self._packet))
        mujoco.mj_forward(model, self.data)

    def take_next(self, timeout_s: float | None = None) -> bool:
        """Wait for the next state and set `data` to it, without skipping any.

        Args:
            timeout_s: maximum time to wait [s]; None to wait for a state or the end of the robot.

        Returns:
            Whether `data` has a new state; if not, the timeout expired, a report arrived, or
            `is_over`.
        """
        if not self._receive(timeout_s):
            return False
        self._show()
        return True

    def take_newest(self, timeout_s: float) -> bool:
        """Like `take_next`, but for the latest available state; earlier ones are skipped."""
        if not self._receive(timeout_s):
            return False
        while self._receive(0.0):
            pass
        self._show()
        return True

    def wait_until_over(self, timeout_s: float) -> bool:
        """Wait until no more states will arrive; those that have arrived can still be taken.

        Args:
            timeout_s: maximum time to wait [s].

        Returns:
            Whether no more states will arrive.
        """
        poll = select.poll()
        poll.register(self._link, select.POLLRDHUP)
        return bool(poll.poll(timeout_s * 1000))

    def _receive(self, timeout_s: float | None) -> bool:
        """Whether a state has arrived; a report counts as a timeout."""
        self._link.settimeout(timeout_s)
        try:
            size = self._link.recv_into(self._next_packet)
        except (BlockingIOError, TimeoutError):
            return False
        except ConnectionResetError:
            size = 0
        self.is_over = size == 0
        if self.is_over:
            return False
        if self._next_packet[0]:
            self.reports.append(self._next_packet[:size].decode())
            return False
        self._packet, self._next_packet = self._next_packet, self._packet
        return True

    def _show(self) -> None:
        state = np.frombuffer(self._packet, np.float64, self._size, offset=8)
        mujoco.mj_setState(self.model, self.data, state, SIGNATURE)
        mujoco.mj_forward(self.model, self.data)


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoJob:
    """The arguments of a video process."""

    path: str
    """Absolute path."""
    camera: int | None
    """Index of the camera; None for a view of the whole model."""
    width: int
    """[pixels]"""
    height: int
    rate_hz: int
    """Frames per second of simulated time."""

    def to_arguments(self) -> tuple[str, ...]:
        """The command-line argument of the process."""
        return (json.dumps(asdict(self)),)

    @classmethod
    def from_arguments(cls, arguments: Sequence[str]) -> Self:
        """Parse the command-line argument."""
        (text,) = arguments
        return cls(**json.loads(text))
