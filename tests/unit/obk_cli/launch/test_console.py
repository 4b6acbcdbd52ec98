"""The screen and the status area below its lines, in a real pseudo terminal."""

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from obk_cli.launch.console import Footer, Screen, open_console, takes_footer
from obk_cli.launch.status import status_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus
from obk_cli.terminal import plain

from ....waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests
from .terminal import Terminal


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    read_fd, write_fd = os.pipe()
    yield read_fd, write_fd
    os.close(write_fd)


def read_to_the_end_of(read_fd: int, last: str) -> list[str]:
    data = b""
    while not data.endswith(f"{last}\n".encode()):
        data += os.read(read_fd, 1 << 16)
    os.close(read_fd)
    return data.decode().splitlines()


def test_lines_are_printed_in_order(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    with Screen(write_fd) as screen:
        for n in range(100):
            screen.put(str(n))
    assert read_to_the_end_of(read_fd, "99") == [str(n) for n in range(100)]


def test_what_libraries_print_is_not_between_json_lines(
    pipe: tuple[int, int], capfd: pytest.CaptureFixture[str]
) -> None:
    read_fd, write_fd = pipe
    options: Any = {"colour": False, "quiet": False, "terminal": ""}
    with open_console(write_fd, as_json=True, **options) as console:
        os.write(write_fd, b"from a library\n")
        console.screen.put("a line")
    os.write(write_fd, b"after it\n")
    assert read_to_the_end_of(read_fd, "after it") == ["a line", "after it"]
    assert capfd.readouterr().err == "from a library\n"


def test_without_a_reader_lines_are_dropped_and_counted(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    with Screen(write_fd, room=10) as screen:
        large = "x" * (1 << 20)  # more than a pipe holds, so the writer stalls in the middle
        screen.put(large)
        first_byte = os.read(read_fd, 1)
        for n in range(1234 + 10):
            screen.put(str(n), may_drop=True)
        screen.put("an event")
        lines = read_to_the_end_of(read_fd, "an event")
    assert first_byte.decode() + lines[0] == large
    assert lines[1:] == [*map(str, range(10)), "... 1234 lines left out", "an event"]


def test_a_reader_that_stalls_does_not_hold_up_the_end(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.launch.console.END_S", 0.01)
    read_fd, write_fd = pipe
    with Screen(write_fd) as screen:
        screen.put("x" * (1 << 20))
    os.close(read_fd)


def test_a_reader_that_leaves_is_reported(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.close(read_fd)
    is_reported = threading.Event()
    with Screen(write_fd) as screen:
        screen.when_closed(is_reported.set)
        screen.put("unread")
        assert is_reported.wait(DEADLINE_S)
        screen.put("nor this")


def test_a_reader_that_left_before_the_question_is_reported_too(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.close(read_fd)
    screen = Screen(write_fd)
    screen.put("unread")
    screen._writer.join(DEADLINE_S)
    is_reported = threading.Event()
    screen.when_closed(is_reported.set)
    assert is_reported.is_set()


def test_a_pipe_that_does_not_wait_is_not_taken_for_closed(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.set_blocking(write_fd, False)
    is_reported = threading.Event()
    with Screen(write_fd) as screen:
        screen.when_closed(is_reported.set)
        large = "x" * (1 << 20)
        screen.put(large)
        screen.put("the last one")
        assert read_to_the_end_of(read_fd, "the last one") == [large, "the last one"]
    assert not is_reported.is_set()


def test_a_full_disk_ends_nothing_and_lost_lines_are_counted(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    read_fd, write_fd = pipe
    is_closed = threading.Event()
    is_full = threading.Event()
    write = os.write

    def write_if_there_is_room(fd: int, data: bytes) -> int:
        if is_full.is_set():
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(fd, data)

    monkeypatch.setattr("os.write", write_if_there_is_room)
    with Screen(write_fd) as screen:
        screen.when_closed(is_closed.set)
        is_full.set()
        for count in range(1, 4):
            screen.put("no room for this")
            eventually(lambda: screen._left_out == count, "the line that was left out")  # noqa: B023
        is_full.clear()
        screen.put("an event")
        lines = read_to_the_end_of(read_fd, "an event")
    assert lines == ["... 3 lines left out", "an event"]
    assert not is_closed.is_set()


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    with closing(Terminal(80, 24)) as made:
        yield made


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("obk_cli.launch.console.REFRESH_S", 0.01)
    monkeypatch.setattr("obk_cli.launch.console.PAUSE_S", 0.0)


def test_the_log_scrolls_above_the_status_and_the_status_leaves_no_trace(
    terminal: Terminal,
) -> None:
    status = ["-----", "a \x1b[32mactive\x1b[0m"]
    with Screen(terminal.slave) as screen:
        screen.set_footer(lambda width, height: status)
        for n in range(100):
            screen.put(f"line {n}")
            terminal.read_until(f"line {n}")
            terminal.read_until("a active")
            assert terminal.rows[-3:] == ["-----", "a active", ""]
        status[1] = "a inactive"
        terminal.read_until("a inactive")
    terminal.read_the_rest()
    assert terminal.rows == [*(f"line {n}" for n in range(100)), ""]
    assert terminal.column == 0


@pytest.mark.parametrize(("width", "height"), [(80, 24), (160, 50)])
def test_a_stack_of_many_nodes_wraps_no_line_and_leaves_the_log_two_thirds(
    terminal: Terminal, width: int, height: int
) -> None:
    terminal.resize(width, height)
    nodes = tuple(
        NodeStatus(
            node=f"/arm/obelisk_{section}_{n}",
            section=section,
            device="onboard",
            state="active",
            process="",
            pid=1,
            restarts=n % 2,
            hangs=n == 3,
        )
        for section in ("sensing", "estimation", "control")
        for n in range(10)
    )
    status = StackStatus(name="many", state="active", phase="active", seconds=1.0, nodes=nodes)

    def draw(width: int, height: int) -> list[str]:
        return status_lines(status, width, height, colour=True)

    expected = [plain(line) for line in draw(width, height)]
    with Screen(terminal.slave) as screen:
        screen.set_footer(draw)
        screen.put("the log")
        terminal.read_until(expected[-1])
        assert terminal.rows == ["the log", *expected, ""]
    assert terminal.wrapped == 0


def test_without_a_reader_lines_are_accepted_and_it_ends(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.launch.console.END_S", 0.01)
    with Screen(terminal.slave, room=10) as screen:
        screen.set_footer(lambda width, height: ["status"])
        for _ in range(1000):
            screen.put("x" * 1000, may_drop=True)
    terminal.read_until("lines left out")  # so that the writing thread continues


def test_unchanged_rows_are_not_written_again(terminal: Terminal) -> None:
    footer = Footer(terminal.slave, lambda width, height: ["status"])
    assert footer.below("") == "status\n"
    assert footer.below("") == ""
    assert footer.below("log\n") == "\r\x1b[1A\x1b[Jlog\nstatus\n"
    assert footer.removed() == "\r\x1b[1A\x1b[J"
    assert footer.removed() == ""


def test_the_status_is_drawn_for_the_size_that_the_terminal_has_by_then(
    terminal: Terminal,
) -> None:
    footer = Footer(terminal.slave, lambda width, height: ["x" * (width - 1)])
    footer.below("")
    terminal.resize(30, 24)
    # 79 characters take three rows of 30.
    assert footer.below("") == "\r\x1b[3A\x1b[J" + "x" * 29 + "\n"


def test_a_status_never_takes_the_whole_terminal(terminal: Terminal) -> None:
    terminal.resize(80, 3)
    footer = Footer(terminal.slave, lambda width, height: list("abcdef"))
    assert footer.below("") == "a\nb\n"


def test_only_a_terminal_that_moves_its_cursor_takes_a_footer(terminal: Terminal) -> None:
    assert takes_footer(terminal.slave, "xterm-256color")
    assert not takes_footer(terminal.slave, "dumb")
    assert not takes_footer(terminal.slave, "")
    read_fd, write_fd = os.pipe()
    assert not takes_footer(write_fd, "xterm-256color")
    os.close(read_fd)
    os.close(write_fd)
