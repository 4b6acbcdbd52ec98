"""The launcher's end of a run's control socket: answers other terminals on this host.

The server takes one request per connection, in the format of `runs.protocol`, and passes it to the
supervisor's inbox. It serves in its own thread: a stalled client does not delay the others, and a
malformed request gets an error. Only this user and root get answers.
"""

import asyncio
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

import msgspec

from obelisk_spec.control_socket import CONTROL_SOCKET
from obk_cli.launch.events import (
    ChangeRequested,
    InputEvent,
    PageReported,
    StatusRequested,
    StopRequested,
)
from obk_cli.runs.protocol import (
    LONGEST_REQUEST,
    LONGEST_WAIT_S,
    ChangeAnswer,
    ChangeRequest,
    Fault,
    GraphAnswer,
    GraphRequest,
    Noted,
    PageRequest,
    StackStatus,
    StatusRequest,
    Stopping,
    StopRequest,
    decode,
    decode_request,
    encode_line,
)

__all__ = ["serve_control"]

AskGraph = Callable[[bytes, Callable[[bytes], None]], object]
"""Takes a query about the ROS graph and a callback, called from another thread, with the answer."""

READ_S: Final = 2.0
"""Limit for receiving a request [s]."""
SEND_S: Final = 2.0
"""Limit for a client to read the answer [s]."""
STATUS_S: Final = 5.0
"""Limit for the supervisor to report the stack's status [s]."""
GRAPH_S: Final = 30.0
"""Limit for a query about the ROS graph, in addition to the time limits in the query [s]."""
END_S: Final = 0.5
"""Limit for sending the last answers at shutdown [s]."""
MOST_CONNECTIONS: Final = 32
_CREDENTIALS: Final = struct.Struct("3i")
"""Process, user and group of the other end; socket(7), SO_PEERCRED."""


@contextmanager
def serve_control(
    folder: Path, put: Callable[[InputEvent], None], ask_graph: AskGraph | None = None
) -> Iterator[None]:
    """Inside the `with` block, put the requests that arrive at a run folder's socket into an inbox.

    Args:
        folder: the run's folder; its path may be too long for a socket address.
        put: takes `StatusRequested`, `ChangeRequested`, `StopRequested` and `PageReported`, from a
            thread.
        ask_graph: answers queries about the ROS graph; None: they are rejected.

    Raises:
        OSError: the socket cannot be created.
    """
    with ExitStack() as stack:
        folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        stack.callback(os.close, folder_fd)
        listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        # Before the socket has a name, so that no other user can ever connect.
        os.fchmod(listener.fileno(), 0o600)
        listener.bind(f"/proc/self/fd/{folder_fd}/{CONTROL_SOCKET}")
        stack.callback(_remove, folder_fd)
        listener.listen(MOST_CONNECTIONS)
        server = _Server(listener, put, ask_graph)
        stack.callback(server.end)
        server.start()
        yield


def _remove(folder_fd: int) -> None:
    with suppress(OSError):  # the folder may no longer exist
        os.unlink(CONTROL_SOCKET, dir_fd=folder_fd)


class _Server:
    """An event loop in a thread."""

    def __init__(
        self, listener: socket.socket, put: Callable[[InputEvent], None], ask_graph: AskGraph | None
    ) -> None:
        self._listener = listener
        self._put = put
        self._ask_graph = ask_graph
        self._loop = asyncio.new_event_loop()
        self._ending = asyncio.Event()
        self._handlers: set[asyncio.Task[None]] = set()
        self._waiting: set[asyncio.Future[bytes]] = set()
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        """Send the last answers, close every connection, stop the thread."""
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
        # Any answer that the supervisor gives while it shuts down comes before this one.
        for answer in self._waiting:
            _settle(answer, encode_line(Fault(error="the stack has ended")))
        if self._handlers:
            await asyncio.wait(self._handlers, timeout=END_S)

    async def _handle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "every connection is served by a task"
        self._handlers.add(task)
        # Makes `drain` wait until everything is sent.
        writer.transport.set_write_buffer_limits(high=0)
        try:
            writer.write(await self._answer(reader, writer))
            async with asyncio.timeout(SEND_S):
                await writer.drain()
        except (OSError, TimeoutError, asyncio.CancelledError):
            return  # the client has disconnected, or stalls
        finally:
            writer.transport.abort()
            self._handlers.discard(task)

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
        if len(self._handlers) > MOST_CONNECTIONS:
            return encode_line(Fault(error=f"more than {MOST_CONNECTIONS} clients are connected"))
        if _user(writer) not in (os.getuid(), 0):
            return encode_line(Fault(error="the stack belongs to another user"))
        try:
            async with asyncio.timeout(READ_S):
                line = await reader.readline()
        except TimeoutError:
            return encode_line(Fault(error=f"no request received within {READ_S:g} s"))
        except ValueError:
            return encode_line(Fault(error=f"a request may have at most {LONGEST_REQUEST} bytes"))
        match decode_request(line):
            case StatusRequest():
                return await self._status()
            case ChangeRequest() as request:
                return await self._change(request)
            case StopRequest(reason=reason):
                self._put(StopRequested(reason=reason))
                return encode_line(Stopping())
            case PageRequest(node=node, url=url):
                self._put(PageReported(node=node, url=url))
                return encode_line(Noted())
            case GraphRequest(question=question):
                return await self._answer_on_graph(question)
            case Fault() as fault:
                return encode_line(fault)

    async def _status(self) -> bytes:
        answer = self._awaited()
        self._put(StatusRequested(reply=self._reply_to(answer)))
        try:
            async with asyncio.timeout(STATUS_S):
                return await answer
        except TimeoutError:
            return encode_line(Fault(error=f"the launcher did not answer within {STATUS_S:g} s"))

    async def _change(self, request: ChangeRequest) -> bytes:
        answer = self._awaited()
        self._put(
            ChangeRequested(
                transition=request.transition,
                nodes=request.nodes,
                timeout_s=request.timeout_s,
                reply=self._reply_to(answer),
            )
        )
        return await answer

    async def _answer_on_graph(self, question: msgspec.Raw) -> bytes:
        if self._ask_graph is None:
            return encode_line(
                Fault(error="the launcher does not answer queries about the ROS graph")
            )
        answer = self._awaited()

        def reply(data: bytes) -> None:
            self._settle_from_a_thread(answer, encode_line(GraphAnswer(value=msgspec.Raw(data))))

        self._ask_graph(bytes(question), reply)
        wait_s = GRAPH_S + _given_s(question)
        try:
            async with asyncio.timeout(wait_s):
                return await answer
        except TimeoutError:
            return encode_line(Fault(error=f"the launcher did not answer within {wait_s:g} s"))

    def _awaited(self) -> "asyncio.Future[bytes]":
        answer: asyncio.Future[bytes] = self._loop.create_future()
        self._waiting.add(answer)
        answer.add_done_callback(self._waiting.discard)
        return answer

    def _reply_to(
        self, answer: "asyncio.Future[bytes]"
    ) -> Callable[[StackStatus | ChangeAnswer], None]:
        def reply(value: StackStatus | ChangeAnswer) -> None:
            self._settle_from_a_thread(answer, encode_line(value))

        return reply

    def _settle_from_a_thread(self, answer: "asyncio.Future[bytes]", line: bytes) -> None:
        with suppress(RuntimeError):  # the loop has ended, and the client has an answer
            self._loop.call_soon_threadsafe(_settle, answer, line)


def _settle(answer: "asyncio.Future[bytes]", line: bytes) -> None:
    if not answer.done():
        answer.set_result(line)


class _Timed(msgspec.Struct, frozen=True):
    timeout_s: float = 0.0


def _given_s(question: bytes | msgspec.Raw) -> float:
    """How long a query waits for a node's answer [s]."""
    try:
        timed: _Timed = decode(question, _Timed)
    except ValueError:
        return 0.0
    return max(0.0, min(timed.timeout_s, LONGEST_WAIT_S))


def _user(writer: asyncio.StreamWriter) -> int:
    other_end: socket.socket = writer.get_extra_info("socket")
    data = other_end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(data)[1])
