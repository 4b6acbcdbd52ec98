"""Connection to the drive over a UDP socket that never blocks.

It sends commands, returns the latest state, and counts faults of the connection. It does not use
ROS. Only `ask` waits for an answer, and is called only while nothing moves.
"""

import socket
import threading
import time
from collections import Counter

from udp_motor_robot.protocol import SEQUENCES, Command, Mode, State, steps_ahead

__all__ = ["DriveLink"]

ASK_AGAIN_S = 0.01
"""Time after which `ask` asks again, because datagrams may be lost [s]."""
LISTEN_AGAIN_S = 0.1
"""Time without a command after which a keep-alive is sent to the drive [s]."""
LONGEST_DATAGRAM = 1500


class DriveLink:
    """A connection to one drive; only `send` and `stop` may be called from several threads."""

    def __init__(self, host: str, port: int) -> None:
        """Open the socket without sending anything.

        Args:
            host: name or IPv4 address of the drive.
            port: UDP port of the drive.

        Raises:
            OSError: the host is unknown or cannot be reached.
            OverflowError: the port number is invalid.
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
        self.received_at_s = time.monotonic()
        """When the last new state was received, on the monotonic clock [s]."""
        self.error = ""
        """Why the last command could not be sent; empty if it was sent."""
        self.faults: Counter[str] = Counter()
        """The number of datagrams that were lost, late or not sent; cleared after each report."""

    def send(self, mode: Mode, value: float = 0.0) -> None:
        """Send a command, or count a fault if that fails.

        Args:
            mode: the meaning of the value.
            value: torque [N m] or position [rad]; finite.
        """
        with self._sending:
            command = Command(sequence=self._next_sequence, mode=mode, value=value)
            self._next_sequence = (self._next_sequence + 1) % SEQUENCES
            self._sent_at_s = time.monotonic()
            self.error = ""
            try:
                self._socket.send(command.pack())
            except OSError as error:  # no drive is running, or the send buffer is full
                self.error = str(error)
                self.faults["commands not sent"] += 1

    def stop(self) -> None:
        """Send zero torque. If the datagram is lost, the drive's watchdog does the same."""
        self.send(Mode.TORQUE, 0.0)

    def newest(self) -> State | None:
        """The latest state received since the last call; None without a new one."""
        if time.monotonic() - self._sent_at_s > LISTEN_AGAIN_S:
            self.send(Mode.LISTEN)
        newest = None
        while (data := self._receive()) is not None:
            state = State.unpack(data)
            if state is None:
                self.faults["invalid datagrams"] += 1
            elif self._is_new(state):
                newest = state
        if newest is not None:
            self.received_at_s = time.monotonic()
        return newest

    def ask(self, timeout_s: float) -> State | None:
        """Stop the motor and wait for a state.

        Args:
            timeout_s: maximum waiting time [s].

        Returns:
            The latest state; None if no state was received in time.
        """
        self.newest()  # drop old states, which prove nothing about the drive
        self._last_sequence = None
        end_s = time.monotonic() + timeout_s
        state = None
        while state is None and time.monotonic() < end_s:
            self.stop()
            time.sleep(ASK_AGAIN_S)
            state = self.newest()
        self.faults.clear()  # count only later faults
        return state

    def close(self) -> None:
        """Stop the motor and close the socket."""
        self.stop()
        self._socket.close()

    def _receive(self) -> bytes | None:
        try:
            return self._socket.recv(LONGEST_DATAGRAM)
        except OSError:  # no datagram, or no drive is running
            return None

    def _is_new(self, state: State) -> bool:
        ahead = 1
        if self._last_sequence is not None:
            ahead = steps_ahead(state.sequence, self._last_sequence)
        if ahead < 1:
            self.faults["states out of order"] += 1
            return False
        if ahead > 1:
            self.faults["states lost"] += ahead - 1
        self._last_sequence = state.sequence
        return True
