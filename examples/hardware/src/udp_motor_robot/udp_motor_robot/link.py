"""The computer's end of the line to the drive: a UDP socket that never blocks.

In: commands to send. Out: the newest state, and what went wrong on the way as counts. Knows
nothing of ROS. Only `ask`, for moments at which
nothing moves yet, waits for an answer.
"""

import socket
import threading
import time
from collections import Counter

from udp_motor_robot.protocol import SEQUENCES, Command, Mode, State, steps_ahead

__all__ = ["DriveLink"]

ASK_AGAIN_S = 0.01
"""How long `ask` waits before it asks again: a datagram may be lost [s]."""
LISTEN_AGAIN_S = 0.1
"""How often a keep-alive is sent to the drive, if nothing else is [s]."""
LONGEST_DATAGRAM = 1500


class DriveLink:
    """A connection to one drive; only `send` and `stop` may be called on several threads."""

    def __init__(self, host: str, port: int) -> None:
        """Open the socket; nothing is sent yet.

        Args:
            host: name or IPv4 address of the drive.
            port: where it listens.

        Raises:
            OSError: the host is not known, or there is no way to it.
            OverflowError: no port has that number.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.connect((host, port))
        except BaseException:
            self._socket.close()
            raise
        self._sending = threading.Lock()
        self._next_sequence = 0
        self._last_sequence: int | None = None
        self._sent_at_s = time.monotonic()
        self.heard_at_s = time.monotonic()
        """When the last new state came, by the monotonic clock [s]."""
        self.error = ""
        """Why the last command could not be sent; empty if it could."""
        self.troubles: Counter[str] = Counter()
        """How many datagrams were lost, came late, or could not be sent; reporting clears it."""

    def send(self, mode: Mode, value: float = 0.0) -> None:
        """Send a command, or count that it could not be sent.

        Args:
            mode: what the value is.
            value: torque [N m] or position [rad]; finite.
        """
        with self._sending:
            command = Command(sequence=self._next_sequence, mode=mode, value=value)
            self._next_sequence = (self._next_sequence + 1) % SEQUENCES
            self._sent_at_s = time.monotonic()
            self.error = ""
            try:
                self._socket.send(command.pack())
            except OSError as error:  # no drive is listening, or the line is full
                self.error = str(error)
                self.troubles["commands not sent"] += 1

    def stop(self) -> None:
        """Send zero torque. Should that be lost, the drive's watchdog does the same."""
        self.send(Mode.TORQUE, 0.0)

    def newest(self) -> State | None:
        """The newest state that has come since the last call; None if none has."""
        if time.monotonic() - self._sent_at_s > LISTEN_AGAIN_S:
            self.send(Mode.LISTEN)
        newest = None
        while (data := self._receive()) is not None:
            state = State.unpack(data)
            if state is None:
                self.troubles["datagrams that are no states"] += 1
            elif self._is_new(state):
                newest = state
        if newest is not None:
            self.heard_at_s = time.monotonic()
        return newest

    def ask(self, timeout_s: float) -> State | None:
        """Stop the motor and wait for a state.

        Args:
            timeout_s: how long to wait at most [s].

        Returns:
            The newest state; None if none came in time.
        """
        self.newest()  # what lies here still is from a drive that may be gone by now
        self._last_sequence = None
        end_s = time.monotonic() + timeout_s
        state = None
        while state is None and time.monotonic() < end_s:
            self.stop()
            time.sleep(ASK_AGAIN_S)
            state = self.newest()
        self.troubles.clear()  # what happens from now on counts
        return state

    def close(self) -> None:
        """Stop the motor and close the socket."""
        self.stop()
        self._socket.close()

    def _receive(self) -> bytes | None:
        try:
            return self._socket.recv(LONGEST_DATAGRAM)
        except OSError:  # no datagram, or no drive is listening
            return None

    def _is_new(self, state: State) -> bool:
        ahead = 1
        if self._last_sequence is not None:
            ahead = steps_ahead(state.sequence, self._last_sequence)
        if ahead < 1:
            self.troubles["states out of order"] += 1
            return False
        if ahead > 1:
            self.troubles["states lost"] += ahead - 1
        self._last_sequence = state.sequence
        return True
