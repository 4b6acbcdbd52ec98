"""An onlooker as the robot sees it: a process below it that is fed with states.

In: a kind of `program.KINDS`, its arguments, the model. Out: a `StateSender` for the stepping
thread, and what the process says, as sentences for the user. Whatever becomes of the process, the
simulation goes on; it ends when the link to the robot does, however the robot ended.
"""

import mmap
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import mujoco
import numpy as np

from obelisk_py.core.sim.mujoco.viewing.states import StateSender
from obelisk_py.core.sim.mujoco.viewing.words import Tell, hear

__all__ = ["TOLD", "Onlooker"]

PROGRAM: Final = "obelisk_py.core.sim.mujoco.viewing"
TOLD: Final = 3
"""Exit code of an onlooker that has said itself why it ends."""
_LOSS: Final = "the simulation goes on without it, and brings it back when it is configured again"
_ROOM: Final = 1 << 22
"""For states on their way [bytes]; the kernel gives what it allows."""


class Onlooker:
    """One process that looks at a simulation."""

    def __init__(
        self,
        kind: str,
        arguments: Sequence[str],
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *,
        tell: Tell,
        end_s: float | None = None,
        loss: str = _LOSS,
    ) -> None:
        """Start it; what it draws and whether it can is told later.

        Args:
            kind: a key of `program.KINDS`.
            arguments: of that kind.
            model: handed to the process as it is now.
            data: its state, that `states` sends.
            tell: takes what the process says and how it ended; called on a thread of its own.
            end_s: how long it may take to finish what it has begun [s]; None: there is nothing.
            loss: what it means that it has ended by itself.
        """
        self._kind = kind
        self._loss = loss
        self._tell = tell
        self._end_s = end_s
        self._is_closing = False
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
        with theirs, _saved(model) as model_fd:
            inherited = (theirs.fileno(), model_fd)
            self._process = subprocess.Popen(
                # -P: what lies in the working folder is no library.
                [sys.executable, "-P", "-m", PROGRAM, kind, *map(str, inherited), *arguments],
                pass_fds=inherited,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                # Signals for the robot's group are not for it. A session of its own would be
                # more than that: the kernel weighs niceness within a session (autogroups).
                process_group=0,
            )
        self.states = StateSender(model, data, self._link, tell)
        """For the stepping thread."""
        self._listener = threading.Thread(target=self._listen, name=f"{kind} onlooker", daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def close(self) -> None:
        """End it: once it has finished where it has something to finish, else at once."""
        if self._is_closing:
            return
        self._is_closing = True
        self._link.shutdown(socket.SHUT_WR)
        if self._end_s is not None:
            self._listener.join(self._end_s)
            if self._listener.is_alive():
                self._tell("warning", f"the {self._kind} viewer did not end in {self._end_s:g} s")
        self._process.kill()
        self._listener.join()
        self._link.close()

    def _listen(self) -> None:
        while (said := hear(self._link)) is not None:
            self._tell(*said)
        code = self._process.wait()
        if code not in (0, TOLD) and not self._is_closing:
            self._tell(
                "warning",
                f"the {self._kind} viewer has ended ({_how(code)}); {self._loss}",
            )


@contextmanager
def _saved(model: mujoco.MjModel) -> Iterator[int]:
    """A file without a name that holds a model; its descriptor."""
    descriptor = os.memfd_create("model")
    try:
        size = mujoco.mj_sizeModel(model)
        os.ftruncate(descriptor, size)
        # Written in place: MuJoCo's own buffer for a file tears holes into the robot's heap, round
        # after round.
        with mmap.mmap(descriptor, size) as memory:
            mujoco.mj_saveModel(model, None, np.frombuffer(memory, np.uint8))
        yield descriptor
    finally:
        os.close(descriptor)


def _how(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"
