"""The environment in which this stack's ROS processes run, and what had to be mended in it."""

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from obk_cli.errors import CommandFailedError

__all__ = ["Network", "RosEnvironment", "ros_environment"]

Network = Literal["localhost", "lan"]

OUR_RMW: Final = "rmw_fastrtps_cpp"
HIGHEST_DOMAIN: Final = 232
DDS_PROFILE: Final = Path(__file__).with_name("dds_profile.xml")


@dataclass(frozen=True, slots=True, kw_only=True)
class RosEnvironment:
    """Variables for ROS processes, and sentences about what was changed for the user."""

    variables: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def domain(self) -> int:
        """The ROS domain."""
        return int(self.variables.get("ROS_DOMAIN_ID", "0"))


def ros_environment(network: Network | None = None) -> RosEnvironment:
    """What this process's environment becomes for ROS.

    Args:
        network: who can discover the stack; None keeps what the user has set, else this host only.

    Raises:
        CommandFailedError: ROS_DOMAIN_ID is no domain; to guess another could move a real robot.
    """
    variables = dict(os.environ)
    notes = []
    ranges = {"localhost": "LOCALHOST", "lan": "SUBNET"}
    if network is not None:
        variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = ranges[network]
    variables.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", ranges["localhost"])
    variables.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(DDS_PROFILE))
    variables["PYTHONUNBUFFERED"] = "1"
    rmw = variables.get("RMW_IMPLEMENTATION")
    if rmw and not _is_installed(rmw, variables):
        notes.append(f"RMW_IMPLEMENTATION={rmw} is not installed here; {OUR_RMW} is used instead")
        variables["RMW_IMPLEMENTATION"] = OUR_RMW
    domain = variables.get("ROS_DOMAIN_ID", "0")
    if not domain.isdecimal() or int(domain) > HIGHEST_DOMAIN:
        raise CommandFailedError(
            f"ROS_DOMAIN_ID={domain} is not a number from 0 to {HIGHEST_DOMAIN}"
        )
    return RosEnvironment(variables=variables, notes=tuple(notes))


def _is_installed(rmw: str, variables: Mapping[str, str]) -> bool:
    prefixes = [p for p in variables.get("AMENT_PREFIX_PATH", "").split(":") if p]
    return any(
        (Path(prefix) / "lib" / f"lib{rmw}.so").is_file() for prefix in (*prefixes, sys.prefix)
    )
