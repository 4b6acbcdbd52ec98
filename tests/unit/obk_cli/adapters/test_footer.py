"""The status area below the lines, in a real pseudo terminal."""

import os
from collections.abc import Iterator
from contextlib import closing

import pytest

from obk_cli.adapters.footer import Footer, takes_footer
from obk_cli.adapters.screen import Screen
from obk_cli.report.escapes import plain
from obk_cli.report.status_area import status_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus

from .terminal import Terminal


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    with closing(Terminal(80, 24)) as made:
        yield made


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("obk_cli.adapters.screen.REFRESH_S", 0.01)
    monkeypatch.setattr("obk_cli.adapters.screen.PAUSE_S", 0.0)


def test_the_log_scrolls_above_the_status_and_nothing_of_that_stays(terminal: Terminal) -> None:
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


def test_while_nobody_reads_lines_are_taken_and_the_end_comes(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("obk_cli.adapters.screen.END_S", 0.01)
    with Screen(terminal.slave, room=10) as screen:
        screen.set_footer(lambda width, height: ["status"])
        for _ in range(1000):
            screen.put("x" * 1000, may_drop=True)
    terminal.read_until("lines left out")  # so that the writing thread gets on


def test_what_has_not_changed_is_not_written_again(terminal: Terminal) -> None:
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
