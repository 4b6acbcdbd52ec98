"""The launcher's end of a run's control socket: answers other terminals on this host.

Takes one request a connection, as `launch.wire` has it, and hands it to the supervisor's inbox.
Serves in a thread of its own: whoever asks and then stalls holds up nobody, and what is no request
gets an answer that says so. Only this user, and root, are heard.
"""

import asyncio
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from obk_cli.launch.answers import emit_answer
from obk_cli.launch.asks import ChangeAnswer, ChangeAsked, StackStatus, StatusAsked
from obk_cli.launch.events import Heard, StopAsked
from obk_cli.launch.wire import (
    CONTROL_SOCKET,
    LONGEST_REQUEST,
    LONGEST_WAIT_S,
    ChangeRequest,
    LookRequest,
    StatusRequest,
    StopRequest,
    emit_fault,
    emit_look,
    parse_request,
)

__all__ = ["Look", "serve_control"]

Look = Callable[[Mapping[str, Any], Callable[[Mapping[str, Any]], None]], object]
"""Takes a question about the ROS graph and what is to be called with the answer, from a thread."""

READ_S: Final = 2.0
"""How long a request may take to come [s]."""
SEND_S: Final = 2.0
"""How long whoever asked may take to read the answer [s]."""
STATUS_S: Final = 5.0
"""How long the supervisor may take to say how the stack is [s]."""
LOOK_S: Final = 30.0
"""How long a question about the ROS graph may take, beside what it gives others [s]."""
END_S: Final = 0.5
"""How long the last answers may take at the end [s]."""
MOST_CONNECTIONS: Final = 32
_CREDENTIALS: Final = struct.Struct("3i")
"""Process, user and group of the other end; socket(7), SO_PEERCRED."""


@contextmanager
def serve_control(
    folder: Path, put: Callable[[Heard], None], look: Look | None = None
) -> Iterator[None]:
    """While entered, requests that come to a run folder's socket are put into an inbox.

    Args:
        folder: the run's; its path may be longer than a socket's address can be.
        put: takes `StatusAsked`, `ChangeAsked` and `StopAsked`, from a thread.
        look: answers questions about the ROS graph; None: they are refused.

    Raises:
        OSError: the socket cannot be made.
    """
    with ExitStack() as stack:
        folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        stack.callback(os.close, folder_fd)
        listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        # Before it has a name: nobody else can connect at any moment.
        os.fchmod(listener.fileno(), 0o600)
        listener.bind(f"/proc/self/fd/{folder_fd}/{CONTROL_SOCKET}")
        stack.callback(_remove, folder_fd)
        listener.listen(MOST_CONNECTIONS)
        server = _Server(listener, put, look)
        stack.callback(server.end)
        server.start()
        yield


def _remove(folder_fd: int) -> None:
    with suppress(OSError):  # the folder may be gone
        os.unlink(CONTROL_SOCKET, dir_fd=folder_fd)


class _Server:
    """An event loop in a thread."""

    def __init__(
        self, listener: socket.socket, put: Callable[[Heard], None], look: Look | None
    ) -> None:
        self._listener = listener
        self._put = put
        self._look = look
        self._loop = asyncio.new_event_loop()
        self._ending = asyncio.Event()
        self._handlers: set[asyncio.Task[None]] = set()
        self._waiting: set[asyncio.Future[bytes]] = set()
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        """Give the last answers, close every connection, end the thread."""
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        server = await asyncio.start_unix_server(
            self._handle, sock=self._listener, limit=LONGEST_REQUEST
        )
        await self._ending.wait()
        server.close()
        # What the supervisor has answered on its way out is there before this.
        for answer in self._waiting:
            _settle(answer, emit_fault("the stack has ended"))
        if self._handlers:
            await asyncio.wait(self._handlers, timeout=END_S)

    async def _handle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "a connection is served by a task"
        self._handlers.add(task)
        # So that `drain` waits until all is sent.
        writer.transport.set_write_buffer_limits(high=0)
        try:
            writer.write(await self._answer(reader, writer))
            async with asyncio.timeout(SEND_S):
                await writer.drain()
        except (OSError, TimeoutError, asyncio.CancelledError):
            return  # whoever asked has left, or stalls
        finally:
            writer.transport.abort()
            self._handlers.discard(task)

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
        if len(self._handlers) > MOST_CONNECTIONS:
            return emit_fault(f"more than {MOST_CONNECTIONS} ask at the same moment")
        if _user(writer) not in (os.getuid(), 0):
            return emit_fault("the stack is another user's")
        try:
            async with asyncio.timeout(READ_S):
                line = await reader.readline()
        except TimeoutError:
            return emit_fault(f"no request came within {READ_S:g} s")
        except ValueError:
            return emit_fault(f"a request has at most {LONGEST_REQUEST} bytes")
        match parse_request(line):
            case StatusRequest():
                return await self._status()
            case ChangeRequest() as request:
                return await self._change(request)
            case StopRequest(reason=reason):
                self._put(StopAsked(reason=reason))
                return emit_answer(None)
            case LookRequest(question=question):
                return await self._look_at(question)
            case str() as fault:
                return emit_fault(fault)

    async def _status(self) -> bytes:
        answer = self._awaited()
        self._put(StatusAsked(reply=self._reply_to(answer)))
        try:
            async with asyncio.timeout(STATUS_S):
                return await answer
        except TimeoutError:
            return emit_fault(f"the launcher has not answered for {STATUS_S:g} s")

    async def _change(self, request: ChangeRequest) -> bytes:
        answer = self._awaited()
        self._put(
            ChangeAsked(
                transition=request.transition,
                nodes=request.nodes,
                timeout_s=request.timeout_s,
                reply=self._reply_to(answer),
            )
        )
        return await answer

    async def _look_at(self, question: Mapping[str, Any]) -> bytes:
        if self._look is None:
            return emit_fault("the launcher does not tell of the ROS graph")
        answer = self._awaited()
        self._look(question, lambda told: self._settle_from_a_thread(answer, emit_look(told)))
        wait_s = LOOK_S + _given_s(question)
        try:
            async with asyncio.timeout(wait_s):
                return await answer
        except TimeoutError:
            return emit_fault(f"the launcher has not answered for {wait_s:g} s")

    def _awaited(self) -> "asyncio.Future[bytes]":
        answer: asyncio.Future[bytes] = self._loop.create_future()
        self._waiting.add(answer)
        answer.add_done_callback(self._waiting.discard)
        return answer

    def _reply_to(
        self, answer: "asyncio.Future[bytes]"
    ) -> Callable[[StackStatus | ChangeAnswer], None]:
        def reply(value: StackStatus | ChangeAnswer) -> None:
            self._settle_from_a_thread(answer, emit_answer(value))

        return reply

    def _settle_from_a_thread(self, answer: "asyncio.Future[bytes]", line: bytes) -> None:
        with suppress(RuntimeError):  # the loop has ended, and whoever asked was told so
            self._loop.call_soon_threadsafe(_settle, answer, line)


def _settle(answer: "asyncio.Future[bytes]", line: bytes) -> None:
    if not answer.done():
        answer.set_result(line)


def _given_s(question: Mapping[str, Any]) -> float:
    """How long a question gives a node to answer [s]."""
    given = question.get("timeout_s")
    wait_s = min(given, LONGEST_WAIT_S) if isinstance(given, int | float) else 0.0
    return wait_s if wait_s > 0 else 0.0


def _user(writer: asyncio.StreamWriter) -> int:
    other_end: socket.socket = writer.get_extra_info("socket")
    data = other_end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(data)[1])
