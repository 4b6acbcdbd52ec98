"""The environment of ROS processes: domain, discovery range, log folder, sourced setup files."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from obk_cli.errors import CommandFailedError

__all__ = [
    "AS_THE_PROFILE_SAYS",
    "DOMAIN",
    "LAN_PROFILE",
    "LOCALHOST_PROFILE",
    "OUR_RMW",
    "PROFILES_FILES",
    "RANGE",
    "Network",
    "RosEnvironment",
    "ros_environment",
    "set_log_folder",
]

LOGS: Final = "ROS_LOG_DIR"
ROS_HOME: Final = "ROS_HOME"


def set_log_folder(variables: MutableMapping[str, str]) -> Iterator[str]:
    """Choose a writable folder for ROS's log files; yields a sentence if it is not the default."""
    fault = _fault(variables)
    if fault is None:
        return
    try:
        instead = _folder_of_this_user()
    except OSError as error:
        yield f"ROS will not start: {fault}, and no other folder is writable ({error})"
        return
    if logs := variables.pop(LOGS, ""):
        # Keep the folder of runs where it would be without this change.
        variables.setdefault("OBK_HOME", f"{logs}/obk")
    variables[ROS_HOME] = str(instead)
    yield f"{fault}; they are written to {instead}/log"


def _fault(variables: MutableMapping[str, str]) -> str | None:
    """Why ROS cannot write log files; None if it can."""
    given = variables.get(LOGS) or f"{variables.get(ROS_HOME) or '~/.ros'}/log"
    home = variables.get("HOME", "")
    if given.startswith("~") and not home:
        return "ROS has no folder for its log files, because HOME is not set"
    folder = Path(home, given[1:].lstrip("/")) if given.startswith("~") else Path(given).absolute()
    # `Path.exists` raises in a folder that this user may not read, such as root's home.
    there = next(place for place in (folder, *folder.parents) if os.path.exists(place))  # noqa: PTH110
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        return f"ROS cannot write its log files into {folder}"
    if there != folder and not shutil.disk_usage(there).free:
        return f"ROS cannot create {folder} for its log files, because the disk is full"
    return None


def _folder_of_this_user() -> Path:
    """A temporary folder that belongs only to this user.

    Raises:
        OSError: no such folder can be created.
    """
    folder = Path(tempfile.gettempdir()) / f"obk-ros-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.lstat().st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to another user")
    return folder


Network = Literal["localhost", "lan"]

OUR_RMW: Final = "rmw_fastrtps_cpp"
HIGHEST_DOMAIN: Final = 232
DOMAIN: Final = "ROS_DOMAIN_ID"
RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS: Final = "ROS_STATIC_PEERS"
OLD_SWITCH: Final = "ROS_LOCALHOST_ONLY"
"""The predecessor of `RANGE`. ROS warns about it and, if it is 1, ignores everything else."""
PROFILES_FILES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Variables that name Fast DDS XML profile files; newer versions use the second."""
SKIP_FOLDER: Final = "SKIP_DEFAULT_XML_FILE"
"""Whether Fast DDS ignores an XML profile file with the default name in the working folder."""
LOCALHOST_PROFILE: Final = str(Path(__file__).with_name("dds_localhost.xml"))
QUICK_PROFILE: Final = str(Path(__file__).with_name("dds_quick.xml"))
LAN_PROFILE: Final = str(Path(__file__).with_name("dds_lan.xml"))
AS_THE_PROFILE_SAYS: Final = "SYSTEM_DEFAULT"
"""The range with which ROS leaves Fast DDS's settings unchanged."""
FAST_DDS: Final = ("", OUR_RMW, "rmw_fastrtps_dynamic_cpp")
"""Middlewares that use these settings; the first is the default of ROS 2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosEnvironment:
    """Variables for ROS processes, and notes about what was changed for the user."""

    variables: Mapping[str, str]
    """All variables of a process; no others are set."""
    range: str
    """Which hosts can be discovered, as a value of ROS_AUTOMATIC_DISCOVERY_RANGE."""
    notes: tuple[str, ...]

    @property
    def domain(self) -> int:
        """The ROS domain."""
        return int(self.variables.get(DOMAIN, "0"))

    @property
    def is_local(self) -> bool:
        """Whether obk's profile limits discovery to this host."""
        return self.variables.get(PROFILES_FILES[0]) == LOCALHOST_PROFILE

    def with_quick_discovery(self) -> "RosEnvironment":
        """The environment of processes that announce themselves more often at first."""
        if not self.is_local:
            return self
        return replace(self, variables={**self.variables, PROFILES_FILES[0]: QUICK_PROFILE})

    def put_into_effect(self) -> None:
        """Set the variables for this process."""
        os.environ.update(self.variables)
        if OLD_SWITCH not in self.variables:
            os.environ.pop(OLD_SWITCH, None)


def ros_environment(
    network: Network | None = None, *, devices_are_split: bool = False
) -> RosEnvironment:
    """Build the ROS environment from this process's environment.

    Args:
        network: which hosts can discover the stack; None: the user's setting, otherwise this host.
        devices_are_split: whether other hosts run other devices of the stack; they can then be
            discovered if neither `network` nor the user sets anything.

    Raises:
        CommandFailedError: ROS_DOMAIN_ID is invalid; guessing another could move a real robot.
    """
    variables = _as_the_user_has_it()
    notes = [*_set_range(variables, network, devices_are_split)]
    discovery_range = variables[RANGE]
    variables["PYTHONUNBUFFERED"] = "1"
    rmw = variables.get("RMW_IMPLEMENTATION")
    if rmw and not _is_installed(rmw, variables):
        notes.append(f"RMW_IMPLEMENTATION={rmw} is not installed; using {OUR_RMW}")
        variables["RMW_IMPLEMENTATION"] = OUR_RMW
    domain = variables.get(DOMAIN, "0")
    if not domain.isdecimal() or int(domain) > HIGHEST_DOMAIN:
        raise CommandFailedError(
            f"ROS_DOMAIN_ID={domain} is not a number from 0 to {HIGHEST_DOMAIN}"
        )
    _set_profile(variables)
    notes += set_log_folder(variables)
    return RosEnvironment(variables=variables, range=discovery_range, notes=tuple(notes))


def _as_the_user_has_it() -> dict[str, str]:
    """This process's variables, without those that a `RosEnvironment` added before."""
    variables = dict(os.environ)
    if not variables.get(DOMAIN):
        variables.pop(DOMAIN, None)  # ROS treats an empty value as not set
    profile = variables.get(PROFILES_FILES[0])
    if profile in (LOCALHOST_PROFILE, QUICK_PROFILE, LAN_PROFILE):
        del variables[PROFILES_FILES[0]]
    if (
        profile in (LOCALHOST_PROFILE, QUICK_PROFILE)
        and variables.get(RANGE) == AS_THE_PROFILE_SAYS
    ):
        variables[RANGE] = "LOCALHOST"
    return variables


def _set_profile(variables: dict[str, str]) -> None:
    """Send messages over UDP only, unless the user has their own Fast DDS settings."""
    if any(variables.get(name) for name in PROFILES_FILES):
        return
    variables[SKIP_FOLDER] = "1"
    is_fast_dds = variables.get("RMW_IMPLEMENTATION", "") in FAST_DDS
    if variables[RANGE] == "LOCALHOST" and not variables.get(PEERS) and is_fast_dds:
        variables[PROFILES_FILES[0]] = LOCALHOST_PROFILE
        variables[RANGE] = AS_THE_PROFILE_SAYS
    else:
        variables[PROFILES_FILES[0]] = LAN_PROFILE


def _set_range(
    variables: dict[str, str], network: Network | None, devices_are_split: bool
) -> Iterator[str]:
    """Set which hosts can discover the stack; yields notes about conflicting settings."""
    # If the old switch is on, ROS ignores everything else.
    is_switched = variables.pop(OLD_SWITCH, "") == "1"
    peers = variables.get(PEERS)
    if network is None and is_switched:
        variables[RANGE] = "LOCALHOST"
    if network is not None:
        variables[RANGE] = {"localhost": "LOCALHOST", "lan": "SUBNET"}[network]
    if network == "lan" and is_switched:
        yield f"{OLD_SWITCH}=1 is ignored for `--network lan`"
    if network == "localhost" and peers:
        del variables[PEERS]
        yield f"{PEERS}={peers} is ignored for `--network localhost`"
    is_set = bool(variables.get(RANGE))
    if not is_set:
        variables[RANGE] = "SUBNET" if devices_are_split else "LOCALHOST"
    elif devices_are_split and variables[RANGE] in ("LOCALHOST", "OFF") and not peers:
        what = f"{OLD_SWITCH}=1" if is_switched else f"{RANGE}={variables[RANGE]}"
        what = "`--network localhost`" if network == "localhost" else what
        yield f"{what} prevents the discovery of devices on other hosts; use `--network lan`"
    if variables[RANGE] == "OFF":
        yield f"{RANGE}=OFF prevents the nodes of a stack from discovering each other"


def _is_installed(rmw: str, variables: Mapping[str, str]) -> bool:
    prefixes = [p for p in variables.get("AMENT_PREFIX_PATH", "").split(":") if p]
    return any(
        (Path(prefix) / "lib" / f"lib{rmw}.so").is_file() for prefix in (*prefixes, sys.prefix)
    )
