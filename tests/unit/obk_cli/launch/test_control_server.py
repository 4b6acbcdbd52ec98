"""The control socket, with a thread in the supervisor's place."""

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


def answer_all(heard: InputEvent) -> None:
    match heard:
        case StatusRequested():
            heard.reply(STATUS)
        case ChangeRequested():
            heard.reply(ANSWER)
        case _:
            return


def leave_open(_: InputEvent) -> None:
    """Like a supervisor that hangs."""


@contextmanager
def served(
    folder: Path, answer: Callable[[InputEvent], None] = answer_all
) -> Iterator["SimpleQueue[InputEvent]"]:
    """A socket whose requests are answered in a thread; gives what was heard."""
    inbox: SimpleQueue[InputEvent | None] = SimpleQueue()
    heard: SimpleQueue[InputEvent] = SimpleQueue()

    def work() -> None:
        while (asked := inbox.get()) is not None:
            heard.put(asked)
            answer(asked)

    worker = threading.Thread(target=work)
    worker.start()
    try:
        with serve_control(folder, inbox.put):
            yield heard
    finally:
        inbox.put(None)
        worker.join()


def raw(folder: Path, data: bytes, *, ends: bool = False) -> dict[str, str]:
    """What a foreign client gets for these bytes."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(DEADLINE_S)
        link.connect(str(folder / "control.sock"))
        try:
            link.sendall(data)
            if ends:
                link.shutdown(socket.SHUT_WR)
        except BrokenPipeError:
            pass  # the answer is there before all was sent
        answer = link.makefile("rb").readline()
    return dict(json.loads(answer))


def test_a_stack_says_how_it_is(tmp_path: Path) -> None:
    with served(tmp_path):
        assert ask_status(tmp_path) == STATUS
        assert ask_status(tmp_path) == STATUS


def test_a_change_is_handed_on_with_all_that_was_asked(tmp_path: Path) -> None:
    with served(tmp_path) as heard:
        answer = ask_change(tmp_path, "activate", ("/a",), timeout_s=2.5, wait_s=DEADLINE_S)
        assert answer == ANSWER
    asked = heard.get()
    assert isinstance(asked, ChangeRequested)
    assert (asked.transition, asked.nodes, asked.timeout_s) == ("activate", ("/a",), 2.5)


def test_a_stop_is_heard_without_waiting_for_the_end(tmp_path: Path) -> None:
    with served(tmp_path, leave_open) as heard:
        assert ask_stop(tmp_path, "requested by `obk stop`")
    assert heard.get() == StopRequested(reason="requested by `obk stop`")


def test_the_socket_is_its_owners_and_gone_at_the_end(tmp_path: Path) -> None:
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


def test_where_the_socket_cannot_be_nothing_is_left_and_nothing_is_taken(tmp_path: Path) -> None:
    (tmp_path / "control.sock").write_text("another's")
    threads = threading.active_count()
    with pytest.raises(OSError, match="in use"), serve_control(tmp_path, answer_all):
        pass
    assert (tmp_path / "control.sock").read_text() == "another's"
    assert threading.active_count() == threads


def test_a_folder_that_is_gone_at_the_end_is_no_fault(tmp_path: Path) -> None:
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
def test_what_is_no_request_gets_an_answer_and_harms_nothing(
    tmp_path: Path, data: bytes, fault: str
) -> None:
    with served(tmp_path) as heard:
        assert fault in raw(tmp_path, data)["error"]
        assert heard.empty()
        assert ask_status(tmp_path) == STATUS


def test_a_last_line_needs_no_end(tmp_path: Path) -> None:
    with served(tmp_path):
        assert raw(tmp_path, b'{"ask": "status"}', ends=True)["name"] == "dummy"


def test_clients_that_stall_or_leave_hold_up_no_one(tmp_path: Path) -> None:
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


def test_too_many_at_once_are_reported_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_server, "MOST_CONNECTIONS", 1)
    with served(tmp_path), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as first:
        first.connect(str(tmp_path / "control.sock"))
        assert raw(tmp_path, b"{}\n") == {"error": "more than 1 clients are connected"}


def test_another_users_requests_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "_user", lambda _: 4711)
    with served(tmp_path) as heard:
        assert raw(tmp_path, b'{"ask": "stop"}\n') == {"error": "the stack belongs to another user"}
        assert heard.empty()


def test_a_supervisor_that_hangs_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_server, "STATUS_S", 0.01)
    with served(tmp_path, leave_open):
        assert raw(tmp_path, b'{"ask": "status"}\n') == {
            "error": "the launcher did not answer within 0.01 s"
        }


def test_a_change_that_is_open_at_the_end_is_answered(tmp_path: Path) -> None:
    answers: list[ChangeAnswer | None] = []
    with served(tmp_path, leave_open) as heard:

        def ask() -> None:
            answers.append(ask_change(tmp_path, "activate", timeout_s=None, wait_s=DEADLINE_S))

        asker = threading.Thread(target=ask)
        asker.start()
        asked = heard.get()
    asker.join()
    assert answers == [ChangeAnswer(success=False, why="the stack has ended")]
    assert isinstance(asked, ChangeRequested)
    asked.reply(ANSWER)  # too late, and no fault


def test_without_an_answer_there_is_none(tmp_path: Path) -> None:
    assert ask_status(tmp_path / "no such folder") is None
    assert ask_status(tmp_path) is None
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(tmp_path / "control.sock"))
        assert ask_status(tmp_path) is None
        listener.listen()
        assert ask_status(tmp_path, 0.01) is None
        assert ask_change(tmp_path, "activate", timeout_s=None, wait_s=0.01) is None
        assert not ask_stop(tmp_path, "reason", 0.01)


def test_a_question_about_the_graph_that_no_one_answers_ends(
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
def test_what_a_question_gives_others_is_bounded(
    question: dict[str, object], given_s: float
) -> None:
    assert control_server._given_s(json.dumps(question).encode()) == given_s
