"""The datagrams of the hardware example, and the computer's end of the connection."""

import math
import socket
from collections.abc import Iterator

import pytest
from udp_motor_robot.link import DriveLink
from udp_motor_robot.protocol import SEQUENCES, Command, Fault, Mode, State, steps_ahead

COMMAND = Command(sequence=7, mode=Mode.POSITION, value=-0.5)
STATE = State(sequence=9, time_s=1.5, position=0.25, velocity=-2.0, faults=Fault.WATCHDOG)


def state(sequence: int) -> State:
    return State(sequence=sequence, time_s=1.0, position=0.0, velocity=0.0, faults=Fault.NONE)


def test_the_bytes_match_the_documented_format() -> None:
    assert COMMAND.pack().hex() == "4f424d43 07000000 02000000 000000000000e0bf".replace(" ", "")
    assert STATE.pack().hex() == (
        "4f424d53 09000000 000000000000f83f 000000000000d03f 00000000000000c0 01000000"
    ).replace(" ", "")


def test_packed_datagrams_can_be_unpacked() -> None:
    assert Command.unpack(COMMAND.pack()) == COMMAND
    assert State.unpack(STATE.pack()) == STATE


@pytest.mark.parametrize(
    "data",
    [
        b"",
        COMMAND.pack()[:-1],
        COMMAND.pack() + b"\0",
        b"XBMC" + COMMAND.pack()[4:],
        COMMAND.pack()[:8] + b"\x63\0\0\0" + COMMAND.pack()[12:],
        Command(sequence=1, mode=Mode.TORQUE, value=math.nan).pack(),
        Command(sequence=1, mode=Mode.TORQUE, value=math.inf).pack(),
    ],
    ids=["empty", "short", "long", "magic", "mode", "nan", "inf"],
)
def test_an_invalid_command_is_none(data: bytes) -> None:
    assert Command.unpack(data) is None


@pytest.mark.parametrize(
    "data", [b"", STATE.pack()[:-1], b"X" + STATE.pack()[1:], STATE.pack()[:8] + b"\xff" * 28]
)
def test_an_invalid_state_is_none(data: bytes) -> None:
    assert State.unpack(data) is None


@pytest.mark.parametrize(
    ("sequence", "last", "ahead"),
    [(5, 4, 1), (9, 4, 5), (4, 4, 0), (3, 4, -1), (0, SEQUENCES - 1, 1), (SEQUENCES - 1, 0, -1)],
)
def test_sequence_numbers_wrap_around(sequence: int, last: int, ahead: int) -> None:
    assert steps_ahead(sequence, last) == ahead


@pytest.fixture
def line() -> Iterator[socket.socket]:
    """The drive's end of the connection, without a drive."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        line.settimeout(10.0)
        yield line


@pytest.fixture
def link(line: socket.socket) -> Iterator[DriveLink]:
    link = DriveLink(*line.getsockname())
    line.connect(link._socket.getsockname())
    yield link
    link.close()


def test_the_latest_state_is_returned_and_faults_are_counted(
    line: socket.socket, link: DriveLink
) -> None:
    for datagram in (state(5).pack(), state(9).pack(), state(8).pack(), b"noise", state(10).pack()):
        line.send(datagram)
    newest = link.newest()
    assert newest == state(10)
    assert link.faults == {
        "states lost": 3,
        "states out of order": 1,
        "invalid datagrams": 1,
    }
    assert link.newest() is None


def test_old_states_do_not_count_as_received(line: socket.socket, link: DriveLink) -> None:
    line.send(state(5).pack())
    link.newest()
    received_at_s = link.received_at_s
    line.send(state(5).pack())
    assert link.newest() is None
    assert link.received_at_s == received_at_s


def test_commands_are_counted_and_closing_stops_the_motor(
    line: socket.socket, link: DriveLink
) -> None:
    link.send(Mode.POSITION, 0.5)
    link.close()
    received = [Command.unpack(line.recv(100)) for _ in range(2)]
    assert received == [
        Command(sequence=0, mode=Mode.POSITION, value=0.5),
        Command(sequence=1, mode=Mode.TORQUE, value=0.0),
    ]


def test_a_missing_drive_is_counted_and_raises_no_exception(
    line: socket.socket, link: DriveLink
) -> None:
    line.close()
    for _ in range(3):
        link.send(Mode.POSITION, 0.5)
    assert link.faults["commands not sent"] > 0
    assert link.newest() is None
    assert link.ask(0.02) is None


def test_a_state_received_before_the_request_is_not_its_answer(
    line: socket.socket, link: DriveLink
) -> None:
    line.send(state(5).pack())
    assert link.ask(0.02) is None


@pytest.mark.parametrize(
    ("host", "port", "error"),
    [("255.255.255.255", 1, PermissionError), ("127.0.0.1", 70_000, OverflowError)],
)
def test_an_unusable_address_leaves_no_open_socket(
    host: str, port: int, error: type[Exception]
) -> None:
    with pytest.raises(error):
        DriveLink(host, port)
