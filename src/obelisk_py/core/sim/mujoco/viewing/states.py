"""States of a simulation on their way to an onlooker.

In, on the robot's side: model and data; each `send` is one packet, MuJoCo's own flat state vector,
that is sent at once or dropped and counted, and never waited for. Out, on the onlooker's side:
`data` of the same model, brought to the state that came. Times in them are simulation time.

The link is a pair of SOCK_SEQPACKET sockets: packets stay whole and in order, and when one side
ends, by whatever means, the other one notices.

Source: https://mujoco.readthedocs.io/en/stable/computation/index.html#the-state
"""

import errno
import select
import socket
from typing import Final

import mujoco
import numpy as np

from obelisk_py.core.sim.mujoco.viewing.words import Tell

__all__ = ["SIGNATURE", "StateSender", "States"]

SIGNATURE: Final = int(
    mujoco.mjtState.mjSTATE_FULLPHYSICS
    | mujoco.mjtState.mjSTATE_USER
    | mujoco.mjtState.mjSTATE_WARMSTART
)
"""Everything that a step starts from, mjSTATE_INTEGRATION: what follows from it is drawn too."""


class StateSender:
    """The robot's end; belongs to the thread that steps."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, link: socket.socket, tell: Tell
    ) -> None:
        """Send states of `data` into `link`.

        Args:
            model: the model.
            data: its state; read in `send` and never changed.
            link: one end of a SOCK_SEQPACKET pair.
            tell: takes what goes wrong, once.
        """
        self.sent = 0
        """States on their way."""
        self.dropped = 0
        """States left out, since the onlooker had not taken the earlier ones."""
        self._model = model
        self._data = data
        self._link = link
        self._tell = tell
        self._state = np.empty(mujoco.mj_stateSize(model, SIGNATURE))
        self._is_open = True

    def send(self) -> None:
        """Send the present state, if there is room for it and somebody to take it."""
        if not self._is_open:
            return
        mujoco.mj_getState(self._model, self._data, self._state, SIGNATURE)
        try:
            self._link.send(self._state.data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except BlockingIOError:
            self.dropped += 1
        except OSError as error:
            self._is_open = False
            # That the onlooker is gone is told by who started it.
            if error.errno == errno.EMSGSIZE:
                self._tell("warning", self._too_large())
        else:
            self.sent += 1

    def _too_large(self) -> str:
        room = self._link.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        return (
            f"a state of this model has {self._state.nbytes} bytes, more than the {room} that a "
            "socket of this machine takes at once: no state is shown; "
            f"`sysctl -w net.core.wmem_max={2 * self._state.nbytes}` makes room"
        )


class States:
    """The onlooker's end: the model, and its data at the state that was taken last."""

    def __init__(self, model: mujoco.MjModel, link: socket.socket) -> None:
        """Take states from `link`; until the first one, `data` is the model's own start."""
        self.model = model
        self.data = mujoco.MjData(model)
        self.is_over = False
        """Whether the robot is gone and every state is taken."""
        self._link = link
        self._state = np.empty(mujoco.mj_stateSize(model, SIGNATURE))
        mujoco.mj_forward(model, self.data)

    def take_next(self, timeout_s: float | None = None) -> bool:
        """Wait for the next state and bring `data` to it; none is left out.

        Args:
            timeout_s: how long to wait [s]; None: until there is one or the robot is gone.

        Returns:
            Whether `data` is at a new state; if not, the time is over, or `is_over`.
        """
        if not self._receive(timeout_s):
            return False
        self._show()
        return True

    def take_newest(self, timeout_s: float) -> bool:
        """The same for the newest state there is; those before it are left out."""
        if not self._receive(timeout_s):
            return False
        while self._receive(0.0):
            pass
        self._show()
        return True

    def wait_until_over(self, timeout_s: float) -> bool:
        """Wait until no more states will come; those that have come are still to be taken.

        Args:
            timeout_s: how long to wait [s].

        Returns:
            Whether no more will come.
        """
        poll = select.poll()
        poll.register(self._link, select.POLLRDHUP)
        return bool(poll.poll(timeout_s * 1000))

    def _receive(self, timeout_s: float | None) -> bool:
        self._link.settimeout(timeout_s)
        try:
            size = self._link.recv_into(self._state.data)
        except (BlockingIOError, TimeoutError):
            return False
        except ConnectionResetError:
            size = 0
        self.is_over = size == 0
        return not self.is_over

    def _show(self) -> None:
        mujoco.mj_setState(self.model, self.data, self._state, SIGNATURE)
        mujoco.mj_forward(self.model, self.data)
