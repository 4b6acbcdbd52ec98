"""Processes of nodes: started and signalled through the warden, their output read line by line."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from obk_cli.adapters import warden
from obk_cli.launch.events import Heard, ProcessEnded, ProcessStarted
from obk_cli.plan import Process

__all__ = ["NodeCommand", "WardenProcesses"]

LAST_WORDS_S = 1.0
"""How long the rest of an ended process's output may take [s]."""
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
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._warden = subprocess.Popen(
                [sys.executable, "-I", "-S", str(Path(warden.__file__))],
                stdin=theirs.fileno(),
                start_new_session=True,
                env={},
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
        self._warden.wait()
        self._listener.join()
        self._link.close()
        for pump in self._pumps.values():
            pump.join()

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
        try:
            socket.send_fds(self._link, [json.dumps(request).encode()], [write_fd])
        except BrokenPipeError:
            self._hear(ProcessEnded(node=process.full_name, code=127, text=NO_WARDEN))
        finally:
            os.close(write_fd)
        pump = threading.Thread(
            target=self._pump, args=(process.full_name, read_fd), name="output", daemon=True
        )
        pump.start()
        self._pumps[process.full_name] = pump

    def signal(self, node: str, number: int) -> None:
        """Send a signal to a node's process and its children that share its group."""
        request = json.dumps({"do": "signal", "node": node, "number": number}).encode()
        # Without a warden there are no nodes: `_listen` has told their ends.
        with suppress(BrokenPipeError):
            self._link.send(request)

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
            for line in output:
                text = line.rstrip("\n")
                if text.strip():
                    self._last_lines[node] = text
                self._on_line(node, text)
