"""Start the warden, and send it requests.

`obk launch` starts the warden before it reads the config, so that the preload server imports the
libraries in the meantime.
"""

import ctypes
import fcntl
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.launch.preloading import Preload, can_preload
from obk_cli.process import warden
from obk_cli.process.identity import launch_marks
from obk_cli.ros.environment import Network, ros_environment

__all__ = ["WardenClient", "early_warden", "running_warden", "shareable"]

SEND_S: Final = 2
"""Limit for sending a request to the warden [s]."""
END_S: Final = 2.0
"""Limit for the warden to exit after its processes, and for the processes that it left [s]."""
POLL_S: Final = 0.01
MOST_DESCRIPTORS: Final = 200
"""Number of descriptors in one request; the kernel allows 253."""
FIRST_SHARED: Final = 256
"""Lowest number of a shared descriptor; those that arrive with a request have lower ones."""


@contextmanager
def early_warden(network: Network | None, *, is_composed: bool) -> Iterator["WardenClient"]:
    """Inside the `with` block, a warden whose preload server imports the libraries.

    Args:
        network: which hosts can discover the stack, as for `ros_environment`.
        is_composed: whether the nodes share a process, so that nothing is forked.
    """
    try:
        environment = ros_environment(network)
    except CommandFailedError:  # reported after the errors in the config
        environment = None
    marks = launch_marks(None)
    preload = None
    if environment is not None and not is_composed and can_preload(environment.variables):
        preload = Preload(environment={**environment.variables, **marks})
    with running_warden(marks, preload) as warden:
        yield warden


@contextmanager
def running_warden(
    marks: Mapping[str, str], preload: Preload | None = None
) -> Iterator["WardenClient"]:
    """Inside the `with` block, a warden runs; at its end, all processes below it are stopped.

    Args:
        marks: variables that identify the warden as part of this launch.
        preload: the server that forks Python processes; None: no server yet.
    """
    client = WardenClient(marks, preload)
    try:
        yield client
    finally:
        client.end()
        client.close()


def shareable(descriptor: int) -> int:
    """Move a descriptor to a number that the warden and the preload server do not use."""
    number = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, FIRST_SHARED)
    os.close(descriptor)
    return number


class WardenClient:
    """The warden of this launch."""

    def __init__(self, marks: Mapping[str, str], preload: Preload | None = None) -> None:
        """Start the warden; see `running_warden`."""
        self._preload: Preload | None = None
        self._has_ended = False
        self._before: set[int] | None = None
        """The children before `adopt_orphans`; None: not called yet."""
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # Not `settimeout`, which would also apply to `receive`.
        self._link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", SEND_S, 0))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(Path(warden.__file__))],
                stdin=theirs.fileno(),
                env={**os.environ, **marks},
                start_new_session=True,
            )
        if preload is not None:
            self.use_preload(preload)

    def adopt_orphans(self) -> None:
        """From now on, kill what the warden leaves if it is killed."""
        self._before = _children()
        _adopt_orphans(is_enabled=True)

    @property
    def pid(self) -> int:
        """The warden's process ID."""
        return self._process.pid

    def use_preload(self, preload: Preload | None) -> None:
        """Make a preload server the only one; a running one that fits continues."""
        if self._preload is not None and (preload is None or not self._preload.fits(preload)):
            self.send({"do": "end preload"})
            self._preload = None
        if self._preload is None and preload is not None:
            self._preload = preload
            self.send(
                {
                    "do": "preload",
                    "arguments": preload.arguments,
                    "environment": dict(preload.environment),
                    "folder": str(Path.cwd()),
                }
            )

    @property
    def preload(self) -> Preload | None:
        """The running preload server."""
        return self._preload

    def share(self, descriptors: Sequence[int]) -> None:
        """Let processes started from now on inherit `shareable` descriptors by their numbers."""
        for start in range(0, len(descriptors), MOST_DESCRIPTORS):
            some = descriptors[start : start + MOST_DESCRIPTORS]
            self.send({"do": "share", "numbers": some}, *some)

    def send(self, request: Mapping[str, object], *fds: int) -> bool:
        """Send a request to the warden; return False if it is gone or does not receive."""
        with os.fdopen(os.memfd_create("request"), "w+", encoding="utf-8") as file:
            file.write(json.dumps(request))  # faster than `json.dump`
            file.seek(0)
            try:
                socket.send_fds(self._link, [b"request"], [file.fileno(), *fds])
            except OSError:
                return False
            return True

    def receive(self) -> bytes:
        """Wait for a packet from the warden; empty once it has ended."""
        try:
            return self._link.recv(warden.LARGEST_PACKET)
        except ConnectionResetError:
            return b""

    def end(self) -> None:
        """Stop the running processes and the warden; only the first call has an effect."""
        if self._has_ended:
            return
        self._has_ended = True
        self.send({"do": "end"})
        self._link.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(warden.GRACE_S + warden.KILL_S + END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        if self._before is not None:
            _end_orphans(self._before)
            _adopt_orphans(is_enabled=False)

    def close(self) -> None:
        """Release the socket after `end`, once no thread is in `receive`."""
        self._link.close()


def _end_orphans(before: set[int]) -> None:
    """Kill the processes inherited from a warden that did not exit cleanly."""
    deadline = time.monotonic() + END_S
    while (orphans := _children() - before) and time.monotonic() < deadline:
        for pid in orphans:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
        time.sleep(POLL_S)


def _children() -> set[int]:
    """The child processes, including adopted ones."""
    found: set[int] = set()
    for children in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):  # the thread has ended
            found |= set(map(int, children.read_text(encoding="ascii").split()))
    return found


def _adopt_orphans(*, is_enabled: bool) -> None:
    """Set whether this process becomes the parent of orphaned descendants."""
    ctypes.CDLL(None).prctl(warden.PR_SET_CHILD_SUBREAPER, int(is_enabled))
