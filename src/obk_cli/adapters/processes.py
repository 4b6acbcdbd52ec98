"""Processes of nodes: started and signalled through the warden, their output read line by line.

What the warden is killed before it could end is ended here: this process adopts it.
"""

import ctypes
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil

from obk_cli.adapters import warden
from obk_cli.launch.events import Heard, ProcessEnded, ProcessStarted
from obk_cli.plan import Process

__all__ = ["NodeCommand", "WardenProcesses"]

LAST_WORDS_S = 1.0
"""How long the rest of an ended process's output may take [s]."""
SEND_S = 2
"""How long a request to the warden may take [s]."""
END_S = 2.0
"""How long what is left may take at the end, each part of it [s]."""
POLL_S = 0.01
LONGEST_LINE = 1 << 16
"""Output without line ends is cut into pieces of this size [characters]."""
NO_WARDEN = "the process that watched over the nodes is gone"


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeCommand:
    """How a node's process is started."""

    arguments: tuple[str, ...]
    environment: Mapping[str, str]


class WardenProcesses:
    """Node processes that die with this one, whatever ends it."""

    def __init__(
        self,
        *,
        commands: Mapping[str, NodeCommand],
        folder: Path,
        hear: Callable[[Heard], None],
        on_line: Callable[[str, str], None],
    ) -> None:
        """Start the warden.

        Args:
            commands: by the nodes' full names.
            folder: the processes' working folder.
            hear: takes `ProcessStarted` and `ProcessEnded`, from a thread.
            on_line: takes a node's full name and a line of its output, from a thread.
        """
        self._commands = commands
        self._folder = folder
        self._hear = hear
        self._on_line = on_line
        self._pumps: dict[str, threading.Thread] = {}
        self._last_lines: dict[str, str] = {}
        self._running: set[str] = set()
        self._before = {child.pid for child in psutil.Process().children()}
        _adopt_orphans(is_wanted=True)
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # Not `settimeout`, which would hold for the listener's wait too.
        self._link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", SEND_S, 0))
        with theirs:
            self._warden = subprocess.Popen(
                [sys.executable, "-I", "-S", str(Path(warden.__file__))],
                stdin=theirs.fileno(),
                start_new_session=True,
            )
        self._listener = threading.Thread(target=self._listen, name="warden", daemon=True)
        self._listener.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End whatever still runs, and the warden."""
        self._link.shutdown(socket.SHUT_RDWR)
        try:
            self._warden.wait(warden.GRACE_S + warden.KILL_S + END_S)
        except subprocess.TimeoutExpired:
            self._warden.kill()
        self._end_orphans()
        _adopt_orphans(is_wanted=False)
        self._listener.join(END_S)
        self._link.close()
        deadline = time.monotonic() + END_S
        for pump in self._pumps.values():
            pump.join(max(0.0, deadline - time.monotonic()))

    def start(self, process: Process) -> None:
        """Start a node's process; `ProcessStarted` or `ProcessEnded` follows."""
        command = self._commands[process.full_name]
        read_fd, write_fd = os.pipe2(os.O_CLOEXEC)
        request = {
            "do": "start",
            "node": process.full_name,
            "arguments": command.arguments,
            "environment": dict(command.environment),
            "folder": str(self._folder),
        }
        is_sent = self._send(request, write_fd)
        os.close(write_fd)
        if not is_sent:
            self._hear(ProcessEnded(node=process.full_name, code=127, text=NO_WARDEN))
        pump = threading.Thread(
            target=self._pump, args=(process.full_name, read_fd), name="output", daemon=True
        )
        pump.start()
        self._pumps[process.full_name] = pump

    def signal(self, node: str, number: int) -> None:
        """Send a signal to a node's process and its children that share its group."""
        # Without a warden there are no nodes: `_listen` has told their ends.
        self._send({"do": "signal", "node": node, "number": number})

    def _send(self, request: Mapping[str, object], *fds: int) -> bool:
        """Hand a request to the warden; False when there is none, or none that listens."""
        with os.fdopen(os.memfd_create("request"), "w+", encoding="utf-8") as file:
            json.dump(request, file)
            file.seek(0)
            try:
                socket.send_fds(self._link, [b"request"], [file.fileno(), *fds])
            except OSError:
                return False
            return True

    def _end_orphans(self) -> None:
        """Kill what came down to this process from a warden that did not end in order."""
        deadline = time.monotonic() + END_S
        while time.monotonic() < deadline:
            children = psutil.Process().children()
            orphans = [child for child in children if child.pid not in self._before]
            if not orphans:
                return
            for orphan in orphans:
                with suppress(psutil.Error):
                    orphan.kill()
                    orphan.wait(max(0.0, deadline - time.monotonic()))

    def _listen(self) -> None:
        while data := self._received():
            news = json.loads(data)
            node = news["node"]
            if news["news"] == "started":
                self._running.add(node)
                self._hear(ProcessStarted(node=node, pid=news["pid"]))
            else:
                self._running.discard(node)
                text = news["text"] or (self._last_words(node) if news["code"] > 0 else "")
                self._hear(ProcessEnded(node=node, code=news["code"], text=text))
        # The nodes die with the warden, and nobody else would tell.
        for node in sorted(self._running):
            self._hear(ProcessEnded(node=node, code=-signal.SIGKILL, text=NO_WARDEN))

    def _last_words(self, node: str) -> str:
        """The last line that a process wrote: of a Python program that died, its exception."""
        pump = self._pumps.get(node)
        if pump is not None:
            pump.join(LAST_WORDS_S)
        return self._last_lines.get(node, "")

    def _received(self) -> bytes:
        try:
            return self._link.recv(warden.LARGEST_PACKET)
        except ConnectionResetError:
            return b""

    def _pump(self, node: str, read_fd: int) -> None:
        with open(read_fd, encoding="utf-8", errors="replace") as output:
            while line := output.readline(LONGEST_LINE):
                text = line.rstrip("\n")
                if text.strip():
                    self._last_lines[node] = text
                self._on_line(node, text)


def _adopt_orphans(*, is_wanted: bool) -> None:
    """Whether this process becomes the parent of those below it whose own parent is gone."""
    ctypes.CDLL(None).prctl(warden.PR_SET_CHILD_SUBREAPER, int(is_wanted))
