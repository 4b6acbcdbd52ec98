"""What runs in an onlooker's process: `python -m ...viewing KIND LINK MODEL [ARGUMENT...]`.

In: the descriptors of the link and of the saved model. Out: an exit code; what the user should know
is said over the link. Ends when the kind's `look` returns, which it does once the states are over.
"""

import importlib
import os
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Protocol, cast

import mujoco

from obelisk_py.core.exceptions import ObeliskConfigError, ObeliskError
from obelisk_py.core.sim.mujoco.viewing.child import TOLD
from obelisk_py.core.sim.mujoco.viewing.states import States
from obelisk_py.core.sim.mujoco.viewing.words import Severity, Tell, say

__all__ = ["KINDS", "NICENESS", "Kind", "Looking", "run"]

_HERE: Final = "obelisk_py.core.sim.mujoco.viewing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """Where a kind of onlooker is found; loaded in its process only."""

    module: str
    """The module whose `look` it is."""
    extra: str
    """The extra of the distribution that brings the libraries it needs."""
    loss: str = "the simulation goes on without it"
    """What it means that it cannot look."""
    is_awaited: bool = False
    """Whether the robot waits for it before it steps; makes way for it itself, after that."""


KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        "native": Kind(module=f"{_HERE}.native", extra="sim"),
        "web": Kind(module=f"{_HERE}.web", extra="viewer"),
        "film": Kind(
            module=f"{_HERE}.film", extra="render", loss="there is no film", is_awaited=True
        ),
    }
)
NICENESS: Final = 10
"""The robot comes first."""


class Looking(Protocol):
    """What the module of a kind has."""

    def look(self, states: States, tell: Tell, arguments: Sequence[str]) -> None:
        """Look at a simulation until its states are over.

        Args:
            states: the model and its states as they come.
            tell: says something to the user.
            arguments: as they were given to `child.Onlooker`.

        Raises:
            ObeliskError: it cannot; the sentence says why and what would help.
        """


def run(kind: str, link_fd: int, model_fd: int, arguments: Sequence[str]) -> int:
    """Be an onlooker; the exit code of the process."""
    if not KINDS[kind].is_awaited:
        os.nice(NICENESS)
    # MuJoCo would write its warnings into a file in the working directory.
    mujoco.set_mju_user_warning(_drop)
    with socket.socket(fileno=link_fd) as link:

        def tell(severity: Severity, text: str) -> None:
            say(link, severity, text)

        try:
            model = mujoco.MjModel.from_binary_path(f"/proc/self/fd/{model_fd}")
            os.close(model_fd)
            _module(kind).look(States(model, link), tell, arguments)
        except ObeliskError as error:
            tell("warning", f"{error}; {KINDS[kind].loss}")
            return TOLD
        except (BrokenPipeError, ConnectionResetError):
            # The robot is gone; there is nobody to tell.
            return TOLD
    return 0


def _module(kind: str) -> Looking:
    try:
        return cast(Looking, importlib.import_module(KINDS[kind].module))
    except ModuleNotFoundError as error:
        raise ObeliskConfigError(
            f"the {kind} viewer needs the library `{error.name}`, which is not installed; "
            f"the extra `{KINDS[kind].extra}` brings it: obelisk-cli[{KINDS[kind].extra}]"
        ) from error


def _drop(_text: str) -> None:
    """Takes a warning of MuJoCo's and does nothing."""
