"""The simulated drive of the hardware example: joint, watchdog, and choice of sender."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import device
import pytest
from device import Drive
from udp_motor_robot.link import DriveLink
from udp_motor_robot.protocol import Command, Fault, Mode

ME, OTHER = ("127.0.0.1", 1), ("127.0.0.1", 2)
STEPS_TO_SWITCH_OFF = 51
DEADLINE_S = 20.0


def send(
    drive: Drive,
    sequence: int,
    mode: Mode = Mode.POSITION,
    value: float = 0.0,
    sender: device.Sender = ME,
) -> None:
    drive.take(Command(sequence=sequence, mode=mode, value=value).pack(), sender)


def run(drive: Drive, steps: int) -> None:
    for _ in range(steps):
        drive.step()


def hold(drive: Drive, mode: Mode, value: float, steps: int) -> None:
    """Send the same command at each step."""
    for sequence in range(drive.commands, drive.commands + steps):
        send(drive, sequence, mode, value)
        drive.step()


def test_the_joint_moves_to_the_commanded_position() -> None:
    drive = Drive()
    hold(drive, Mode.POSITION, 0.5, steps=1000)
    assert drive.position == pytest.approx(0.5, abs=1e-3)
    assert drive.state().faults is Fault.NONE


def test_a_torque_accelerates_by_inertia_and_friction() -> None:
    drive = Drive()
    hold(drive, Mode.TORQUE, 0.1, steps=10_000)
    assert drive.velocity == pytest.approx(0.1 / drive.motor.damping, rel=1e-3)


def test_without_commands_the_motor_is_off_until_the_next_one() -> None:
    drive = Drive()
    assert drive.state().faults is Fault.WATCHDOG
    send(drive, 0, value=1.0)
    run(drive, STEPS_TO_SWITCH_OFF - 1)
    assert drive.state().faults is Fault.NONE
    run(drive, 1)
    assert drive.state().faults is Fault.WATCHDOG
    velocity = drive.velocity
    run(drive, 1)
    assert 0 < drive.velocity < velocity
    send(drive, 1, value=1.0)
    assert drive.state().faults is Fault.NONE


def test_a_keep_alive_does_not_reset_the_watchdog() -> None:
    drive = Drive()
    send(drive, 0, value=1.0)
    for sequence in range(1, 100):
        send(drive, sequence, Mode.LISTEN)
        drive.step()
    assert drive.state().faults is Fault.WATCHDOG
    assert drive.listener == ME


def test_overspeed_switches_off_until_zero_torque_is_commanded() -> None:
    drive = Drive()
    hold(drive, Mode.TORQUE, 2.0, steps=500)
    assert drive.faults & Fault.OVERSPEED
    hold(drive, Mode.POSITION, 0.0, steps=10)
    assert drive.faults & Fault.OVERSPEED
    drive.velocity = 0.0
    send(drive, drive.commands, Mode.TORQUE, 0.0)
    drive.step()
    assert drive.faults is Fault.NONE


def test_old_commands_and_other_senders_are_ignored_while_it_is_commanded() -> None:
    drive = Drive()
    send(drive, 10, value=0.5)
    send(drive, 10, value=0.1)
    send(drive, 9, value=0.2)
    send(drive, 11, value=0.3, sender=OTHER)
    drive.take(b"noise", OTHER)
    assert drive.commands == 1
    assert drive.listener == ME
    run(drive, STEPS_TO_SWITCH_OFF)
    send(drive, 0, value=0.3, sender=OTHER)
    assert drive.commands == 2
    assert drive.listener == OTHER


def test_a_silent_listener_is_forgotten() -> None:
    drive = Drive()
    send(drive, 0)
    run(drive, 1001)
    assert drive.listener is None


def test_states_are_counted() -> None:
    drive = Drive()
    run(drive, 3)
    assert [drive.state().sequence for _ in range(3)] == [0, 1, 2]
    assert drive.state().time_s == pytest.approx(0.003)


@contextmanager
def running(*arguments: str) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, device.__file__, *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [2, 15])
def test_the_program_answers_and_ends_cleanly(number: int) -> None:
    with running("--port", "0") as process:
        assert process.stdout is not None
        greeting = process.stdout.readline()
        assert greeting.startswith("device: listening on 127.0.0.1:")
        link = DriveLink("127.0.0.1", int(greeting.rpartition(":")[2]))
        state = link.ask(DEADLINE_S)
        link.close()
        assert state is not None
        assert state.position == 0.0
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == 0
        assert process.stdout.read().startswith("device: off after ")


def test_a_port_in_use_is_reported() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        with running("--port", port) as process:
            assert process.wait(DEADLINE_S) == 1
            assert process.stderr is not None
            assert process.stderr.read().startswith(f"device: cannot use port {port}: ")
