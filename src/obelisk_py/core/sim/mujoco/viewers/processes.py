"""Start and stop viewer processes, and send them the robot's states.

The stepping thread has one output per viewer. Messages of a viewer process are passed to the user.
The simulation continues regardless of the viewer. The viewer ends when the link to the robot is
closed, even if the robot crashed.
"""

import mmap
import os
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import mujoco
import numpy as np

from obelisk_py.core.exceptions import ObeliskConfigError
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_times import SampleTimes
from obelisk_py.core.sim.mujoco.stepper import TimedOutput
from obelisk_py.core.sim.mujoco.viewers.viewer_controls import ViewerControls
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import (
    EXIT_REPORTED,
    TOKEN_VARIABLE,
    Notify,
    StateSender,
    receive_message,
    send_report,
)
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import Report, report_text

__all__ = [
    "PARAMETERS",
    "ViewerHost",
    "ViewerProcess",
    "ViewerRequest",
    "requested_viewers",
    "viewer_outputs",
]

PROGRAM: Final = "obelisk_py.core.sim.mujoco.viewers.program"
_LOSS: Final = (
    "the simulation continues without it; the next `configure` transition starts it again"
)
_ROOM: Final = 1 << 22
"""Requested buffer for states that were sent but not received [bytes]; the kernel may limit it."""
PARAMETERS: Final[Mapping[str, str | int]] = MappingProxyType({"viewer": "none", "viewer_port": 0})
"""ROS parameter -> its default, which sets its type."""
VIEWERS: Final = ("none", "native", "web")
_HIGHEST_PORT: Final = 65535
_REPORT_PERIOD_S: Final = 0.2
"""Maximum time until a viewer learns that the robot's state has changed [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerHost:
    """What a robot offers its viewers."""

    controls: ViewerControls
    name: str
    """Name of the robot, for titles."""
    token: str
    """The secret that opens the page."""
    notify: Notify
    """Called with the viewers' messages, on separate threads."""
    show_page: Callable[[str], None]
    """Called with the URL of a page, and with an empty string when the page is gone."""


class ViewerProcess:
    """A viewer process of a simulation."""

    def __init__(
        self,
        kind: str,
        arguments: Sequence[str],
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *,
        notify: Notify,
        host: ViewerHost | None = None,
        end_s: float | None = None,
        loss: str = _LOSS,
    ) -> None:
        """Start the process; `notify` later reports what it shows, or why it cannot.

        Args:
            kind: a key of `program.VIEWER_KINDS`.
            arguments: arguments of this kind.
            model: passed to the process in its current form.
            data: the model's state, which `states` sends.
            notify: called with messages from the process and when it exits, on a separate thread.
            host: carries out what the viewer requests; None if it requests nothing.
            end_s: timeout to finish its work at shutdown [s]; None if it has nothing to finish.
            loss: consequence for the user if it exits by itself.
        """
        self._kind = kind
        self._loss = loss
        self._notify = notify
        self._host = host
        self._reported: Report | None = None
        """The robot's state as last reported to the viewer."""
        self._end_s = end_s
        self._is_closing = False
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
        with theirs, _saved(model) as model_fd:
            inherited = (theirs.fileno(), model_fd)
            self._process = subprocess.Popen(
                # -P keeps files in the working directory from being imported.
                [sys.executable, "-P", "-m", PROGRAM, kind, *map(str, inherited), *arguments],
                env=os.environ if host is None else {**os.environ, TOKEN_VARIABLE: host.token},
                pass_fds=inherited,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                # Shields it from signals to the robot's process group. A separate session would go
                # too far: the kernel applies niceness only within a session (autogroups).
                process_group=0,
            )
        self.states = StateSender(model, data, self._link, notify)
        """Sends states; for the stepping thread."""
        self._listener = threading.Thread(target=self._listen, name=f"{kind} viewer", daemon=True)
        self._listener.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def close(self) -> None:
        """Stop the process: after its work if it has something to finish, otherwise immediately."""
        if self._is_closing:
            return
        self._is_closing = True
        self._link.shutdown(socket.SHUT_WR)
        if self._end_s is not None:
            self._listener.join(self._end_s)
            if self._listener.is_alive():
                self._notify(
                    "warning", f"the {self._kind} viewer did not exit within {self._end_s:g} s"
                )
        self._process.kill()
        self._listener.join()
        self._link.close()

    def _listen(self) -> None:
        self._wait()
        while (message := receive_message(self._link)) is not None:
            match message:
                case ("request", text):
                    if self._host is not None:
                        self._report(self._host.controls.answer(text))
                case ("page", text):
                    if self._host is not None:
                        self._host.show_page(text)
                case (severity, text):
                    self._notify(severity, text)
            self._wait()
        if self._host is not None:
            self._host.show_page("")
        code = self._process.wait()
        if code not in (0, EXIT_REPORTED) and not self._is_closing:
            self._notify(
                "warning",
                f"the {self._kind} viewer has exited ({_how(code)}); {self._loss}",
            )

    def _wait(self) -> None:
        """Wait for a message; meanwhile, report changes of the robot's state to the viewer."""
        if self._host is None:
            return
        poll = select.poll()
        poll.register(self._link, select.POLLIN)
        while not poll.poll(_REPORT_PERIOD_S * 1000):
            report = self._host.controls.report()
            if report != self._reported:
                self._report(report)

    def _report(self, report: Report) -> None:
        self._reported = replace(report, answer="", is_done=True)
        send_report(self._link, report_text(report))


@contextmanager
def _saved(model: mujoco.MjModel) -> Iterator[int]:
    """Write a model to an anonymous file, and yield its descriptor."""
    descriptor = os.memfd_create("model")
    try:
        size = mujoco.mj_sizeModel(model)
        os.ftruncate(descriptor, size)
        # In place: for a file, MuJoCo would allocate a buffer that fragments the robot's heap.
        with mmap.mmap(descriptor, size) as memory:
            mujoco.mj_saveModel(model, None, np.frombuffer(memory, np.uint8))
        yield descriptor
    finally:
        os.close(descriptor)


def _how(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerRequest:
    """A requested viewer."""

    kind: str
    """A key of `program.VIEWER_KINDS`."""
    arguments: tuple[str, ...] = ()


def requested_viewers(parameter: Callable[[str], Any]) -> tuple[ViewerRequest, ...]:
    """Return the viewers that a node's parameters request.

    Args:
        parameter: returns the value of one of `PARAMETERS`.

    Raises:
        ObeliskConfigError: a value is invalid.
    """
    return tuple(_viewer(parameter))


def viewer_outputs(
    simulation: Simulation,
    requests: Iterable[ViewerRequest],
    steps_per_view: int,
    *,
    host: ViewerHost,
    on_close: Callable[[Callable[[], None]], object],
) -> tuple[TimedOutput, ...]:
    """Start viewers, and return the outputs that send them states.

    Args:
        simulation: the simulation to show.
        requests: the viewers to start.
        steps_per_view: number of steps between two states.
        host: what the robot offers them.
        on_close: registers functions to call when the simulation is closed.
    """
    outputs = []
    for request in requests:
        viewer = ViewerProcess(
            request.kind,
            (*request.arguments, host.name),
            simulation.model,
            simulation.data,
            notify=host.notify,
            host=host,
        )
        on_close(viewer.close)
        outputs.append(_output(viewer, steps_per_view))
    return tuple(outputs)


def _output(viewer: ViewerProcess, steps_per_view: int) -> TimedOutput:
    send = viewer.states.send

    def publish(_stamp: Any) -> None:
        send()

    return TimedOutput(
        times=SampleTimes(period_s=float(steps_per_view), step_s=1.0),
        publish=publish,
        # Shows the initial state of a run too.
        restart=send,
    )


def _viewer(parameter: Callable[[str], Any]) -> list[ViewerRequest]:
    viewer, port = parameter("viewer"), parameter("viewer_port")
    if viewer not in VIEWERS:
        raise ObeliskConfigError(
            f"the parameter `viewer` is `{viewer}`; expected one of: {', '.join(VIEWERS)}"
        )
    if not 0 <= port <= _HIGHEST_PORT:
        raise ObeliskConfigError(
            f"the parameter `viewer_port` is {port}, expected a port from 1 to {_HIGHEST_PORT}, "
            "or 0 for a free one"
        )
    if viewer == "none":
        return []
    return [ViewerRequest(kind=viewer, arguments=(str(port),) if viewer == "web" else ())]
