"""Keep nodes from outliving the launcher: the process between them, and the parent of all nodes.

The warden runs as its own program (`python -I -S warden.py`); its standard input is one end of a
Unix socket of packets. It takes JSON requests and sends JSON events (`started`, `ended`). Each
request is a file passed by descriptor, because an environment may be larger than a packet: `start`,
with a second descriptor for the output, `signal`, `share`, `preload`, `end preload`, and finally
`end`. `share` brings descriptors that processes may inherit, each under the number that it has in
the launcher. The warden is the parent of the nodes and adopts their orphans (child subreaper). When
the launcher's end of the socket closes, for any reason, all of them receive SIGTERM, then SIGKILL.
If the launcher did not send `end`, the warden also clears shared memory. It imports the standard
library only, so that it starts at once.

`preload` starts the preload server (`preload.py`), which forks Python nodes. If there is no server,
or it does not fork a node, the warden starts that node in the ordinary way.
Source: prctl(2), PR_SET_CHILD_SUBREAPER and PR_SET_PDEATHSIG.
"""

import ctypes
import json
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

__all__ = ["GRACE_S", "KILL_S", "LARGEST_PACKET", "PR_SET_CHILD_SUBREAPER", "Warden", "main"]

PR_SET_PDEATHSIG = 1
PR_SET_CHILD_SUBREAPER = 36
GRACE_S = 1.0
"""Time between SIGTERM and SIGKILL after the launcher has ended [s]."""
KILL_S = 5.0
"""Limit for processes to exit after SIGKILL; processes stuck in the kernel are left [s]."""
RETRY_S = 0.1
"""Wait before rechecking an orphan whose environment was not readable yet [s]."""
LARGEST_PACKET = 1 << 16
MOST_DESCRIPTORS = 253
"""Number of descriptors in a packet that the kernel allows."""
START_MARK = "OBK_START"
"""The environment variable that identifies the start from which a process descends."""
SWEEPER = Path(__file__).with_name("shared_memory.py")
PRELOAD_S = 15.0
"""Limit for the preload server to import the libraries [s]."""
FORK_S = 5.0
"""Limit for forking a node [s]."""


@dataclass(frozen=True)
class Start:
    """The start of a node."""

    request: Mapping[str, Any]
    output: int
    mark: str
    """The value of `START_MARK`."""

    @property
    def node(self) -> str:
        """The node's name."""
        return str(self.request["node"])


class PreloadClient:
    """The preload server, and the starts that it has not answered; it handles one at a time."""

    def __init__(
        self, request: Mapping[str, Any], shared: Collection[int], in_child: Callable[[], None]
    ) -> None:
        """Start the server.

        Args:
            request: the server's command, environment and folder.
            shared: descriptors that it inherits.
            in_child: prepares the new process.

        Raises:
            OSError: the server cannot be started.
        """
        self.link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.waiting: deque[Start] = deque()
        self._is_ready = False
        self._deadline = time.monotonic() + PRELOAD_S
        with theirs:
            self._process = subprocess.Popen(
                request["arguments"],
                env=request["environment"],
                cwd=request["folder"],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=shared,
                preexec_fn=in_child,
            )
        self._process.returncode = 0  # the warden reaps all children

    @property
    def left_s(self) -> float | None:
        """Remaining time for the server to answer [s]; None if nothing waits for it."""
        return max(0.0, self._deadline - time.monotonic()) if self.waiting else None

    def add(self, start: Start) -> None:
        """Request to fork a node."""
        self.waiting.append(start)
        if self._is_ready and len(self.waiting) == 1:
            self._hand_over()

    def share(self, numbers: Sequence[int]) -> None:
        """Pass on descriptors, for the processes that are forked from now on."""
        with _file_of(numbers) as file, suppress(OSError):  # `answers` reports that it has ended
            socket.send_fds(self.link, [b"share"], [file.fileno(), *numbers])

    def answers(self) -> Iterator[tuple[Start, int | None]]:
        """The answered starts, each with its PID, or None if it was not forked.

        Raises:
            ConnectionResetError: the server has ended.
        """
        while True:
            try:
                data = self.link.recv(LARGEST_PACKET, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            if not data:
                raise ConnectionResetError
            if self._is_ready:
                yield self.waiting.popleft(), json.loads(data)["pid"]
            self._is_ready = True
            if self.waiting:
                self._hand_over()

    def withdraw(self, node: str) -> Start | None:
        """Withdraw the start of a node; None if there is none, or it is being answered now."""
        begun = self.waiting[0] if self._is_ready and self.waiting else None
        for start in self.waiting:
            if start.node == node and start is not begun:
                self.waiting.remove(start)
                return start
        if begun is not None and begun.node == node and not self._has_news():
            self.kill()
            self._has_news()
        return None

    def kill(self) -> None:
        """Kill the server; `answers` raises soon after."""
        _kill(self._process.pid, signal.SIGKILL)
        self._deadline = time.monotonic() + FORK_S

    def _has_news(self) -> bool:
        """Whether the server answers, or ends, in time."""
        poll = select.poll()
        poll.register(self.link, select.POLLIN)
        return bool(poll.poll((self.left_s or 0.0) * 1000))

    def _hand_over(self) -> None:
        self._deadline = time.monotonic() + FORK_S
        start = self.waiting[0]
        request = {
            **start.request["preloaded"],
            "folder": start.request["folder"],
            "inherited": start.request["inherited"],
        }
        request["variables"] = {**request["variables"], START_MARK: start.mark}
        with _file_of(request) as file, suppress(OSError):  # `answers` reports that it has ended
            socket.send_fds(self.link, [b"request"], [file.fileno(), start.output])


def _file_of(content: object) -> TextIO:
    """A file without a name, with the content as JSON."""
    file = os.fdopen(os.memfd_create("request"), "w+", encoding="utf-8")
    file.write(json.dumps(content))  # faster than `json.dump`
    file.seek(0)
    return file


class Warden:
    """The nodes' parent."""

    def __init__(self, link: socket.socket, libc: ctypes.CDLL) -> None:
        self._link = link
        self._libc = libc
        self._pid = os.getpid()
        self._pids: dict[int, str] = {}
        self._starts: dict[int, str] = {}
        """Process -> its `START_MARK`, which its child processes inherit."""
        self._ended_starts: set[str] = set()
        """The starts whose process has ended."""
        self._terminated: set[int] = set()
        """Orphans that received SIGTERM."""
        self._has_unknown_orphan = False
        """Whether the environment of an orphan was not readable yet."""
        self._count = 0
        self._selector = selectors.DefaultSelector()
        self._shared: list[int] = []
        """Descriptors that processes may inherit."""
        self._preload: PreloadClient | None = None
        self.ends_cleanly = False
        """Whether the launcher sent `end`."""

    def serve(self) -> None:
        """Answer requests until the launcher's end of the socket closes."""
        children_fd = _child_signals()
        with self._selector as selector:
            selector.register(self._link, selectors.EVENT_READ)
            selector.register(children_fd, selectors.EVENT_READ)
            while True:
                ready = selector.select(self._timeout_s())
                if not ready:
                    self._terminate_orphans()
                    self._end_late_preload()
                for key, _ in ready:
                    if key.fileobj == children_fd:
                        os.read(children_fd, 512)
                        self._reap()
                    elif key.fileobj != self._link:
                        self._read_preload()
                    elif not self._answer():
                        return

    def end_all(self) -> None:
        """Terminate every process below this one: SIGTERM, a grace time, SIGKILL."""
        if self._preload is not None:  # waiting starts are dropped
            self._preload.link.close()
            self._preload = None
        deadline = time.monotonic() + GRACE_S
        for pid in _children():
            _terminate(pid)
        while _children() and time.monotonic() < deadline:
            self._reap()
            time.sleep(0.01)
        deadline = time.monotonic() + KILL_S
        while _children() and time.monotonic() < deadline:
            for pid in _children():
                _kill_group(pid, signal.SIGKILL)
                _kill(pid, signal.SIGKILL)
            self._reap()
            time.sleep(0.01)

    def _answer(self) -> bool:
        try:
            data, fds, _, _ = socket.recv_fds(self._link, LARGEST_PACKET, MOST_DESCRIPTORS)
        except ConnectionResetError:
            return False
        if not data:
            return False
        with os.fdopen(fds[0], encoding="utf-8") as file:
            request = json.load(file)
        if request["do"] == "start":
            self._count += 1
            start = Start(request=request, output=fds[1], mark=f"{self._pid}:{self._count}")
            if request["preloaded"] is not None and self._preload is not None:
                self._preload.add(start)
            else:
                self._start(start)
        elif request["do"] == "share":
            self._share(request["numbers"], fds[1:])
        elif request["do"] == "preload":
            self._start_preload(request)
        elif request["do"] == "end preload":
            self._end_preload()
        elif request["do"] == "end":
            self.ends_cleanly = True
        else:
            self._signal(request["node"], request["number"])
        return True

    def _start(self, start: Start) -> None:
        """Start a node's program in the ordinary way."""
        request = start.request
        try:
            # The Popen object is discarded: children are reaped here, all in one place.
            child = subprocess.Popen(
                request["arguments"],
                env={**request["environment"], START_MARK: start.mark},
                cwd=request["folder"],
                stdin=subprocess.DEVNULL,
                stdout=start.output,
                stderr=start.output,
                start_new_session=True,
                pass_fds=request["inherited"],
                preexec_fn=self._in_child,
            )
        except (OSError, ValueError, subprocess.SubprocessError) as error:
            text = f"it cannot start: {error}"
            self._send(event="ended", node=start.node, code=127, text=text)
        else:
            child.returncode = 0
            self._started(start, child.pid)
        finally:
            os.close(start.output)

    def _started(self, start: Start, pid: int) -> None:
        self._pids[pid] = start.node
        self._starts[pid] = start.mark
        self._send(event="started", node=start.node, pid=pid)

    def _share(self, numbers: Sequence[int], fds: Sequence[int]) -> None:
        # The launcher chooses numbers above those of descriptors that a packet brings.
        for fd, number in zip(fds, numbers, strict=True):
            os.dup2(fd, number, inheritable=False)
            os.close(fd)
        self._shared += numbers
        if self._preload is not None:
            self._preload.share(numbers)

    def _start_preload(self, request: Mapping[str, Any]) -> None:
        try:
            self._preload = PreloadClient(request, self._shared, self._in_child)
        except (OSError, ValueError, subprocess.SubprocessError):
            return  # nodes start without it
        self._selector.register(self._preload.link, selectors.EVENT_READ)

    def _read_preload(self) -> None:
        """Process the preload server's answers; without it, start the waiting nodes."""
        preload = self._preload
        if preload is None:
            return
        try:
            for start, pid in preload.answers():
                if pid is None:
                    self._start(start)
                else:
                    os.close(start.output)
                    self._started(start, pid)
        except ConnectionResetError:
            self._forget_preload(preload)

    def _forget_preload(self, preload: PreloadClient) -> None:
        """Start the nodes that wait for the server in the ordinary way."""
        self._preload = None
        self._selector.unregister(preload.link)
        preload.link.close()
        for start in preload.waiting:
            self._start(start)

    def _end_preload(self) -> None:
        if self._preload is not None:
            self._preload.kill()
            self._forget_preload(self._preload)

    def _end_late_preload(self) -> None:
        if self._preload is not None and self._preload.left_s == 0.0:
            self._preload.kill()

    def _timeout_s(self) -> float | None:
        """Limit for waiting for the next event [s]; None: no limit."""
        if self._has_unknown_orphan:
            return RETRY_S
        return self._preload.left_s if self._preload is not None else None

    def _in_child(self) -> None:
        self._libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != self._pid:  # the warden was killed before that
            os._exit(1)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    def _signal(self, node: str, number: int) -> None:
        withdrawn = self._preload.withdraw(node) if self._preload is not None else None
        if withdrawn is not None:
            os.close(withdrawn.output)
            self._send(event="ended", node=node, code=-number, text="")
        self._read_preload()
        for pid, name in self._pids.items():
            if name == node:
                _kill_group(pid, number)

    def _reap(self) -> None:
        for pid, status in _reaped():
            self._read_preload()  # it may have forked the process before that ended
            node = self._pids.pop(pid, None)
            self._terminated.discard(pid)
            if node is not None:
                # Children that the node left behind must not continue without it.
                _kill_group(pid, signal.SIGKILL)
                self._ended_starts.add(self._starts.pop(pid))
                self._terminate_orphans()
                self._send(
                    event="ended", node=node, code=os.waitstatus_to_exitcode(status), text=""
                )
        self._terminate_orphans()

    def _terminate_orphans(self) -> None:
        """Send SIGTERM, once, to processes that ended nodes have started in their own sessions."""
        self._has_unknown_orphan = False
        for pid in _children():
            if pid in self._pids or pid in self._terminated:
                continue
            mark = _start_mark(pid)
            self._has_unknown_orphan |= mark is None
            if mark in self._ended_starts:
                self._terminated.add(pid)
                _terminate(pid)

    def _send(self, **event: object) -> None:
        try:
            self._link.send(json.dumps(event).encode())
        except OSError:
            # The launcher has ended; `serve` detects the closed socket.
            return


def _child_signals() -> int:
    """A descriptor that receives a byte for each SIGCHLD.

    The launcher handles the signals that request a shutdown: `systemctl stop` sends SIGTERM to all
    processes, and a second one from here would interrupt the nodes' cleanup.
    """
    read_fd, write_fd = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
    signal.set_wakeup_fd(write_fd, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    return read_fd


def _reaped() -> Iterator[tuple[int, int]]:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid == 0:
            return
        yield pid, status


def _children() -> list[int]:
    """The child processes, including adopted ones."""
    return [int(pid) for pid in Path("/proc/thread-self/children").read_text().split()]


def _terminate(pid: int) -> None:
    """Send SIGTERM to a process and its group, once: a second one makes nodes hurry."""
    try:
        os.killpg(pid, signal.SIGTERM)
    except (ProcessLookupError, PermissionError):  # it does not lead a group
        _kill(pid, signal.SIGTERM)


def _start_mark(pid: int) -> str | None:
    """The mark in a process's environment; empty without one, None if not readable yet.

    During `exec`, the kernel shows an empty environment, for up to 30 ms on a busy machine.
    """
    try:
        environment = Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:  # ended in the meantime, or another user's
        return ""
    if not environment:
        return None
    prefix = f"{START_MARK}=".encode()
    found = (
        entry.removeprefix(prefix) for entry in environment.split(b"\0") if entry.startswith(prefix)
    )
    return os.fsdecode(next(found, b""))


def _kill_group(pid: int, number: int) -> None:
    try:
        os.killpg(pid, number)
    except (ProcessLookupError, PermissionError):
        return


def _kill(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except (ProcessLookupError, PermissionError):
        return


def main() -> None:
    """Serve on standard input until the other end closes."""
    libc = ctypes.CDLL(None)
    libc.prctl(PR_SET_CHILD_SUBREAPER, 1)
    with socket.socket(fileno=os.dup(sys.stdin.fileno())) as link:
        warden = Warden(link, libc)
        try:
            warden.serve()
        finally:
            warden.end_all()
    if not warden.ends_cleanly:
        os.execv(sys.executable, [sys.executable, "-I", "-S", str(SWEEPER)])  # noqa: S606 - itself


if __name__ == "__main__":
    main()
