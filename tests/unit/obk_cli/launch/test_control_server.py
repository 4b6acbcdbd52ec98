"""The control socket, with a thread instead of the supervisor."""

import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue

import pytest

from obk_cli.launch import control_server
from obk_cli.launch.control_server import serve_control
from obk_cli.launch.events import ChangeRequested, InputEvent, StatusRequested, StopRequested
from obk_cli.runs.protocol import (
    ChangeAnswer,
    Member,
    StackStatus,
    ask_change,
    ask_status,
    ask_stop,
)

from ....waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests

STATUS = StackStatus(name="dummy", state="active", phase="active", seconds=1.5, nodes=())
ANSWER = ChangeAnswer(success=True, members=(Member(node="/a", result="reached", state="active"),))


def answer_all(received: InputEvent) -> None:
    match received:
        case StatusRequested():
            received.reply(STATUS)
        case ChangeRequested():
            received.reply(ANSWER)
        case _:
            return


def leave_open(_: InputEvent) -> None:
    """Like a supervisor that hangs."""


@contextmanager
def served(
    folder: Path, answer: Callable[[InputEvent], None] = answer_all
) -> Iterator["SimpleQueue[InputEvent]"]:
    """A socket whose requests a thread answers; yields the received requests."""
    inbox: SimpleQueue[InputEvent | None] = SimpleQueue()
    received: SimpleQueue[InputEvent] = SimpleQueue()

    def work() -> None:
        while (asked := inbox.get()) is not None:
            received.put(asked)
            answer(asked)

    worker = threading.Thread(target=work)
    worker.start()
    try:
        with serve_control(folder, inbox.put):
            yield received
    finally:
        inbox.put(None)
        worker.join()


def raw(folder: Path, data: bytes, *, ends: bool = False) -> dict[str, str]:
    """The reply to a foreign client for these bytes."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(DEADLINE_S)
        link.connect(str(folder / "control.sock"))
        try:
            link.sendall(data)
            if ends:
                link.shutdown(socket.SHUT_WR)
        except BrokenPipeError:
            pass  # the reply arrives before everything was sent
        answer = link.makefile("rb").readline()
    return dict(json.loads(answer))


def test_a_stack_reports_its_status(tmp_path: Path) -> None:
    with served(tmp_path):
        assert ask_status(tmp_path) == STATUS
        assert ask_status(tmp_path) == STATUS


def test_a_change_is_forwarded_with_all_its_options(tmp_path: Path) -> None:
    with served(tmp_path) as received:
        answer = ask_change(tmp_path, "activate", ("/a",), timeout_s=2.5, wait_s=DEADLINE_S)
        assert answer == ANSWER
    asked = received.get()
    assert isinstance(asked, ChangeRequested)
    assert (asked.transition, asked.nodes, asked.timeout_s) == ("activate", ("/a",), 2.5)


def test_a_stop_is_heard_without_waiting_for_the_end(tmp_path: Path) -> None:
    with served(tmp_path, leave_open) as received:
        assert ask_stop(tmp_path, "requested by `obk stop`")
    assert received.get() == StopRequested(reason="requested by `obk stop`")


def test_the_socket_belongs_to_its_owner_and_is_removed_at_the_end(tmp_path: Path) -> None:
    threads = threading.active_count()
    descriptors = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    with served(tmp_path):
        assert (tmp_path / "control.sock").stat().st_mode & 0o777 == 0o600
    assert list(tmp_path.iterdir()) == []
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == descriptors  # noqa: PTH208


def test_a_path_longer_than_a_sockets_address_works(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 50)
    folder.mkdir()
    with served(folder):
        assert ask_status(folder) == STATUS


def test_if_the_socket_cannot_be_created_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "control.sock").write_text("another's")
    threads = threading.active_count()
    with pytest.raises(OSError, match="in use"), serve_control(tmp_path, answer_all):
        pass
    assert (tmp_path / "control.sock").read_text() == "another's"
    assert threading.active_count() == threads


def test_a_folder_deleted_before_the_end_is_no_fault(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    with served(folder):
        folder.rename(tmp_path / "moved")
    assert list((tmp_path / "moved").iterdir()) == []


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"hello\n", "invalid request: "),
        (b"x" * 1_000_000, "65536 bytes"),
        (b'{"ask": "dance"}\n', "$.ask"),
    ],
)
def test_invalid_requests_get_a_reply_and_are_harmless(
    tmp_path: Path, data: bytes, fault: str
) -> None:
    with served(tmp_path) as received:
        assert fault in raw(tmp_path, data)["error"]
        assert received.empty()
        assert ask_status(tmp_path) == STATUS


def test_a_last_line_needs_no_end(tmp_path: Path) -> None:
    with served(tmp_path):
        assert raw(tmp_path, b'{"ask": "status"}', ends=True)["name"] == "dummy"


def test_clients_that_stall_or_leave_block_no_others(tmp_path: Path) -> None:
    with served(tmp_path):
        stalled = []
        for _ in range(control_server.MOST_CONNECTIONS - 1):
            link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            link.connect(str(tmp_path / "control.sock"))
            stalled.append(link)
        stalled[0].send(b'{"ask": "status"}\n')
        stalled[0].close()
        assert ask_status(tmp_path) == STATUS
        for link in stalled:
            link.close()


def test_a_client_that_sends_nothing_is_reported_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "READ_S", 0.01)
    with served(tmp_path):
        assert raw(tmp_path, b"{") == {"error": "no request received within 0.01 s"}


def test_too_many_clients_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_server, "MOST_CONNECTIONS", 1)
    with served(tmp_path), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as first:
        first.connect(str(tmp_path / "control.sock"))
        assert raw(tmp_path, b"{}\n") == {"error": "more than 1 clients are connected"}


def test_requests_of_another_user_are_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "_user", lambda _: 4711)
    with served(tmp_path) as received:
        assert raw(tmp_path, b'{"ask": "stop"}\n') == {"error": "the stack belongs to another user"}
        assert received.empty()


def test_a_supervisor_that_hangs_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "STATUS_S", 0.01)
    with served(tmp_path, leave_open):
        assert raw(tmp_path, b'{"ask": "status"}\n') == {
            "error": "the launcher did not answer within 0.01 s"
        }


def test_an_unfinished_change_is_answered_at_the_end(tmp_path: Path) -> None:
    answers: list[ChangeAnswer | None] = []
    with served(tmp_path, leave_open) as received:

        def ask() -> None:
            answers.append(ask_change(tmp_path, "activate", timeout_s=None, wait_s=DEADLINE_S))

        asker = threading.Thread(target=ask)
        asker.start()
        asked = received.get()
    asker.join()
    assert answers == [ChangeAnswer(success=False, why="the stack has ended")]
    assert isinstance(asked, ChangeRequested)
    asked.reply(ANSWER)  # too late, but not a fault


def test_without_a_reply_the_result_is_none(tmp_path: Path) -> None:
    assert ask_status(tmp_path / "no such folder") is None
    assert ask_status(tmp_path) is None
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(tmp_path / "control.sock"))
        assert ask_status(tmp_path) is None
        listener.listen()
        assert ask_status(tmp_path, 0.01) is None
        assert ask_change(tmp_path, "activate", timeout_s=None, wait_s=0.01) is None
        assert not ask_stop(tmp_path, "reason", 0.01)


def test_an_unanswered_request_about_the_graph_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "GRAPH_S", 0.05)
    question = json.dumps({"ask": "look", "question": {"about": "graph", "timeout_s": 0.05}})
    with serve_control(tmp_path, leave_open, lambda _question, _reply: None):
        reported = raw(tmp_path, question.encode() + b"\n")
    assert reported == {"error": "the launcher did not answer within 0.1 s"}


@pytest.mark.parametrize(
    ("question", "given_s"),
    [
        ({}, 0.0),
        ({"timeout_s": 7.5}, 7.5),
        ({"timeout_s": 1e300}, 3600.0),
        ({"timeout_s": float("nan")}, 0.0),
        ({"timeout_s": "long"}, 0.0),
        ({"timeout_s": -1}, 0.0),
    ],
)
def test_replies_to_a_request_are_bounded(question: dict[str, object], given_s: float) -> None:
    assert control_server._given_s(json.dumps(question).encode()) == given_s
