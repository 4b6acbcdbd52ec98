"""Decide which node processes the preload server forks, and how the server starts. Pure.

A forked process has the libraries that the server has imported, and the server's interpreter and
environment. So only programs of this Python are forked, and only if their environment agrees with
the server's in every variable that a library might read on import.
"""

import os
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.process import preload
from obk_cli.ros.environment import PROFILES_FILES

__all__ = ["Preload", "can_preload", "preload_for"]

SWITCH: Final = "OBK_PRELOAD"
"""Environment variable that disables preloading if set to `off`."""
MESSAGES: Final = (
    "builtin_interfaces",
    "diagnostic_msgs",
    "lifecycle_msgs",
    "obelisk_control_msgs",
    "obelisk_estimator_msgs",
    "obelisk_sensor_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "service_msgs",
    "std_msgs",
    "type_description_interfaces",
)
SERVICES: Final = ("lifecycle_msgs", "rcl_interfaces", "std_srvs", "type_description_interfaces")
"""Packages with types that most nodes use."""
MODULES: Final = (
    "rclpy",
    # Code generators, which ROS loads with the first compiled message.
    "rosidl_generator_py",
    "obelisk_py.core.control",
    "obelisk_py.core.estimation",
    "obelisk_py.core.robot",
    "obelisk_py.core.sensing",
    "obelisk_py.core.utils.ros",
    *(f"{package}.msg" for package in MESSAGES),
    *(f"{package}.srv" for package in SERVICES),
)
"""Modules that nearly every node imports; missing ones are skipped."""
FEWEST: Final = 2
"""A single process would not start sooner."""
OWN_PREFIX: Final = "OBK_"
"""Prefix of variables that only the runtime library reads, when a node is created."""
PATH: Final = "PYTHONPATH"
READ_LATE: Final = (PATH, "AMENT_PREFIX_PATH", PROFILES_FILES[0])
"""Variables that take effect in a forked process too: it adds the first to its search path, ROS
reads the second at each search, and DDS reads the third when the first node is created."""
HOOKS: Final = ("COV", "LD_PRELOAD")
"""Prefixes of variables through which tools measure or replace parts of a process from its
start."""
FORKABLE: Final = (("-P", "-c"), ("-P", "-m"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Preload:
    """The preload server of a run."""

    environment: Mapping[str, str]
    """The server's environment: the variables that all processes have in common."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """The command that starts the server."""
        return (sys.executable, "-P", str(Path(preload.__file__)), *MODULES)

    def fits(self, other: "Preload") -> bool:
        """Whether this server can fork the processes of another one."""
        return self._variables(other.environment) is not None

    def forked(
        self, arguments: Sequence[str], environment: Mapping[str, str]
    ) -> Mapping[str, object] | None:
        """The request to fork a process; None: it is started in the ordinary way.

        Args:
            arguments: of the program as run by this Python, `python -P -m ...`; empty if it is not.
            environment: the process's environment.
        """
        variables = self._variables(environment) if _is_forkable(arguments) else None
        if variables is None:
            return None
        path = self._added_path(environment)
        return {"arguments": arguments, "variables": variables, "path": path}

    def _variables(self, environment: Mapping[str, str]) -> Mapping[str, str] | None:
        """The variables that a forked process sets; None if others differ from the server's."""
        if self.environment.keys() - environment.keys() or self._added_path(environment) is None:
            return None
        changed = {
            name: value
            for name, value in environment.items()
            if self.environment.get(name) != value
        }
        return changed if all(map(_is_own, changed)) else None

    def _added_path(self, environment: Mapping[str, str]) -> Sequence[str] | None:
        """The folders in front of the server's PYTHONPATH; None if the rest differs."""
        own, theirs = (_folders(variables) for variables in (self.environment, environment))
        added = theirs[: len(theirs) - len(own)]
        return added if [*added, *own] == theirs else None


def can_preload(environment: Mapping[str, str]) -> bool:
    """Whether processes with this environment may be forked."""
    is_off = environment.get(SWITCH) == "off"
    return not is_off and not any(name.startswith(HOOKS) for name in environment)


def preload_for(
    programs: Collection[Sequence[str]], environment: Mapping[str, str]
) -> Preload | None:
    """The preload server for a run; None: every process starts in the ordinary way.

    Args:
        programs: the arguments of each process, as for `Preload.forked`.
        environment: the variables that all processes have in common.
    """
    if not can_preload(environment) or sum(map(_is_forkable, programs)) < FEWEST:
        return None
    return Preload(environment=environment)


def _is_forkable(arguments: Sequence[str]) -> bool:
    return arguments[:1] == (sys.executable,) and tuple(arguments[1:3]) in FORKABLE


def _is_own(name: str) -> bool:
    return name in READ_LATE or name.startswith(OWN_PREFIX)


def _folders(environment: Mapping[str, str]) -> list[str]:
    return [folder for folder in environment.get(PATH, "").split(os.pathsep) if folder]
