"""Simulate a motor drive with one joint on 127.0.0.1, which uses the datagrams of `protocol.py`.

    python examples/hardware/device.py [--port 47001]

Runs until Ctrl-C. The drive is not part of the stack: it uses neither ROS nor Obelisk, and like a
real drive it protects itself. It switches the motor off after 50 ms without a command. After
overspeed, the motor stays off until a command of zero torque. Only one sender can command it at a
time, until that sender is silent.
"""

import argparse
import math
import select
import signal
import socket
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "src" / "udp_motor_robot"))

from udp_motor_robot.protocol import PORT, SEQUENCES, Command, Fault, Mode, State, steps_ahead

STEP_S = 0.001
"""The period of the drive's own loop [s]."""
WATCHDOG_S = 0.05
"""Time without a command after which the motor is switched off [s]."""
LISTENER_S = 1.0
"""Time for which states are sent to the last sender [s]."""
LONGEST_CATCH_UP_S = 0.1
"""Longest delay that the drive catches up with; the rest is skipped [s]."""
OVERSPEED = 50.0
"""Speed above which the motor is switched off [rad/s]."""

Sender = tuple[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Motor:
    """A joint with inertia and friction: J dv/dt = torque - d v."""

    inertia: float = 0.01
    """J [kg m^2]."""
    damping: float = 0.02
    """d [N m s/rad]."""
    stiffness: float = 20.0
    """Proportional gain of the drive's position loop [N m/rad]."""
    loop_damping: float = 0.8
    """Derivative gain of the drive's position loop [N m s/rad]."""
    largest_torque: float = 2.0
    """[N m]."""

    def torque(self, mode: Mode, value: float, position: float, velocity: float) -> float:
        """The torque of the motor for a command [N m]."""
        wanted = value
        if mode is Mode.POSITION:
            wanted = self.stiffness * (value - position) - self.loop_damping * velocity
        return max(-self.largest_torque, min(wanted, self.largest_torque))

    def step(self, position: float, velocity: float, torque: float) -> tuple[float, float]:
        """Position and velocity one step later (semi-implicit Euler)."""
        velocity += (torque - self.damping * velocity) / self.inertia * STEP_S
        return position + velocity * STEP_S, velocity


class Drive:
    """The motor and its protection; times are counted in steps of the drive."""

    def __init__(self, motor: Motor | None = None) -> None:
        self.motor = motor or Motor()
        self.position = 0.0
        self.velocity = 0.0
        self.faults = Fault.WATCHDOG
        self.listener: Sender | None = None
        self.commands = 0
        self._step = 0
        self._mode, self._value = Mode.TORQUE, 0.0
        self._master: Sender | None = None
        self._last_sequence = 0
        self._commanded_at = self._received_at = -math.inf
        self._next_sequence = 0

    def take(self, data: bytes, sender: Sender) -> None:
        """Handle a datagram; ignore anything but a new command of the current sender."""
        command = Command.unpack(data)
        if command is None:
            return
        is_held = not self._is_off
        if is_held and sender != self._master:
            return
        self.listener, self._received_at = sender, self._step
        if command.mode is Mode.LISTEN:
            return
        if is_held and steps_ahead(command.sequence, self._last_sequence) < 1:
            return
        self._master, self._last_sequence = sender, command.sequence
        self._mode, self._value = command.mode, command.value
        self._commanded_at = self._step
        self.commands += 1
        self.faults &= ~Fault.WATCHDOG
        if command.mode is Mode.TORQUE and command.value == 0.0:
            self.faults = Fault.NONE

    def step(self) -> None:
        """Advance by one step."""
        self._step += 1
        if (self._step - self._commanded_at) * STEP_S > WATCHDOG_S:
            self.faults |= Fault.WATCHDOG
        if (self._step - self._received_at) * STEP_S > LISTENER_S:
            self.listener = None
        if abs(self.velocity) > OVERSPEED:
            self.faults |= Fault.OVERSPEED
        torque = 0.0
        if not self.faults:
            torque = self.motor.torque(self._mode, self._value, self.position, self.velocity)
        self.position, self.velocity = self.motor.step(self.position, self.velocity, torque)

    def state(self) -> State:
        """The state of the drive, with the next sequence number."""
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % SEQUENCES
        return State(
            sequence=sequence,
            time_s=self._step * STEP_S,
            position=self.position,
            velocity=self.velocity,
            faults=self.faults,
        )

    @property
    def _is_off(self) -> bool:
        return bool(self.faults & Fault.WATCHDOG)


def serve(drive: Drive, line: socket.socket, is_over: threading.Event) -> None:
    """Run the drive in real time until `is_over` is set."""
    next_step_s = time.monotonic()
    while not is_over.is_set():
        select.select([line], [], [], max(0.0, next_step_s - time.monotonic()))
        take_all(drive, line)
        now_s = time.monotonic()
        next_step_s = max(next_step_s, now_s - LONGEST_CATCH_UP_S)
        is_due = next_step_s <= now_s
        while next_step_s <= now_s:
            drive.step()
            next_step_s += STEP_S
        if is_due and drive.listener is not None:
            send_state(line, drive.state(), drive.listener)


def take_all(drive: Drive, line: socket.socket) -> None:
    """Handle all received datagrams."""
    while True:
        try:
            drive.take(*line.recvfrom(1500))
        except BlockingIOError:
            return
        except ConnectionError:  # a listener has closed its socket
            continue


def send_state(line: socket.socket, state: State, listener: Sender) -> None:
    """Send a state; if that fails, the state is lost, as on a real network."""
    try:
        line.sendto(state.pack(), listener)
    except OSError:
        return


def main() -> int:
    """Run the drive until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description="A simulated motor drive on 127.0.0.1.")
    parser.add_argument("--port", type=int, default=PORT, help="UDP port; 0: any free port")
    port = parser.parse_args().port
    is_over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: is_over.set())
    drive = Drive()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        try:
            line.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            print(f"device: cannot use port {port}: {error}", file=sys.stderr)
            return 1
        line.setblocking(False)
        print(f"device: listening on 127.0.0.1:{line.getsockname()[1]}", flush=True)
        serve(drive, line, is_over)
    print(f"device: off after {drive.commands} commands, at {drive.position:.3f} rad")
    return 0


if __name__ == "__main__":
    sys.exit(main())
