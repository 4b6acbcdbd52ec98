"""Run a viewer process: `python -m ...program KIND LINK MODEL [ARGUMENT...]`.

LINK and MODEL are descriptors of the link and of the saved model. Messages for the user are sent
over the link. The process ends when the `run` function of the kind returns, after the last state.
"""

import importlib
import os
import socket
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Protocol, cast

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.sim.mujoco.viewers.priority import lower_priority
from obelisk_py.core.sim.mujoco.viewers.viewer_messages import (
    EXIT_REPORTED,
    MessageKind,
    Send,
    States,
    send_message,
)

__all__ = ["VIEWER_KINDS", "ViewerKind", "ViewerModule", "main", "run_viewer"]

_HERE: Final = "obelisk_py.core.sim.mujoco.viewers"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerKind:
    """How to load a kind of viewer; only its own process imports the module."""

    module: str
    """Module with the `run` function."""
    extra: str
    """Extra of the distribution that installs the required libraries."""
    loss: str = "the simulation continues without it"
    """Consequence for the user if it cannot run."""
    is_awaited: bool = False
    """Whether the robot waits for it before the first step; it then lowers its own priority."""


VIEWER_KINDS: Final[Mapping[str, ViewerKind]] = MappingProxyType(
    {
        "native": ViewerKind(module=f"{_HERE}.native", extra="sim"),
        "web": ViewerKind(module=f"{_HERE}.web", extra="viewer"),
        "video": ViewerKind(
            module=f"{_HERE}.video_process",
            extra="render",
            loss="no video is saved",
            is_awaited=True,
        ),
    }
)


class ViewerModule(Protocol):
    """The interface of a viewer's module."""

    def run(self, states: States, send: Send, arguments: Sequence[str]) -> None:
        """Show a simulation until no more states arrive.

        Args:
            states: the model, and its states as they arrive.
            send: sends a message to the user or a request to the robot.
            arguments: as passed to `processes.ViewerProcess`.

        Raises:
            ObeliskError: the viewer cannot run; the message has the reason and a fix.
        """


def run_viewer(kind: str, link_fd: int, model_fd: int, arguments: Sequence[str]) -> int:
    """Run a viewer, and return the exit code of the process."""
    if not VIEWER_KINDS[kind].is_awaited:
        lower_priority()
    # By default, MuJoCo writes its warnings to a file in the working directory.
    mujoco.set_mju_user_warning(_drop)
    with socket.socket(fileno=link_fd) as link:

        def send(kind: MessageKind, text: str) -> None:
            send_message(link, kind, text)

        try:
            model = mujoco.MjModel.from_binary_path(f"/proc/self/fd/{model_fd}")
            os.close(model_fd)
            _module(kind).run(States(model, link), send, arguments)
        except ObeliskError as error:
            send("warning", f"{error}; {VIEWER_KINDS[kind].loss}")
            return EXIT_REPORTED
        except (BrokenPipeError, ConnectionResetError):
            # The robot process has ended, so nothing would receive a report.
            return EXIT_REPORTED
    return 0


def _module(kind: str) -> ViewerModule:
    try:
        return cast(ViewerModule, importlib.import_module(VIEWER_KINDS[kind].module))
    except ModuleNotFoundError as error:
        extra = VIEWER_KINDS[kind].extra
        raise ObeliskConfigError(
            f"the {kind} viewer needs the library `{error.name}`, which is not installed; "
            f"install the `{extra}` extra: obelisk-cli[{extra}]"
        ) from error


def _drop(_text: str) -> None:
    """Ignore a MuJoCo warning."""


def main() -> int:
    """Run a viewer with the arguments of the command line."""
    kind, link_fd, model_fd, *arguments = sys.argv[1:]
    return run_viewer(kind, int(link_fd), int(model_fd), arguments)


if __name__ == "__main__":
    sys.exit(main())
