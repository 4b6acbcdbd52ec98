"""The screen: whoever does not read holds up nobody."""

import errno
import os
import threading
from collections.abc import Iterator

import pytest

from obk_cli.launch.console import Screen

from ....waiting import DEADLINE_S, eventually  # noqa: TID252 - shared by folders of tests


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


def test_lines_come_out_in_order(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    with Screen(write_fd) as screen:
        for n in range(100):
            screen.put(str(n))
    assert read_to_the_end_of(read_fd, "99") == [str(n) for n in range(100)]


def test_while_nobody_reads_lines_are_left_out_and_counted(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    with Screen(write_fd, room=10) as screen:
        large = "x" * (1 << 20)  # more than a pipe holds: the writer stalls in the middle of it
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


def test_a_reader_that_leaves_is_told(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.close(read_fd)
    is_told = threading.Event()
    with Screen(write_fd) as screen:
        screen.when_closed(is_told.set)
        screen.put("nobody reads this")
        assert is_told.wait(DEADLINE_S)
        screen.put("nor this")


def test_a_reader_that_left_before_anybody_asked_is_told_too(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.close(read_fd)
    screen = Screen(write_fd)
    screen.put("nobody reads this")
    screen._writer.join(DEADLINE_S)
    is_told = threading.Event()
    screen.when_closed(is_told.set)
    assert is_told.is_set()


def test_a_pipe_that_does_not_wait_is_not_taken_for_closed(pipe: tuple[int, int]) -> None:
    read_fd, write_fd = pipe
    os.set_blocking(write_fd, False)
    is_told = threading.Event()
    with Screen(write_fd) as screen:
        screen.when_closed(is_told.set)
        large = "x" * (1 << 20)
        screen.put(large)
        screen.put("the last one")
        assert read_to_the_end_of(read_fd, "the last one") == [large, "the last one"]
    assert not is_told.is_set()


def test_a_full_disk_ends_nothing_and_what_it_does_not_take_is_counted(
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
