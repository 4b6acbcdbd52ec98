"""The `ros` and `rmw` checks: which ROS 2 and middleware this Python would use; imports neither."""

import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from obk_cli.doctor.finding import Finding, error, note, ok, warning
from obk_cli.errors import CommandFailedError
from obk_cli.install_source import install_command
from obk_cli.optional_deps import distribution_version, wheels_distribution
from obk_cli.ros.environment import OUR_RMW, ros_environment

__all__ = [
    "RmwFacts",
    "RosFacts",
    "find_rclpy",
    "judge_rmw",
    "judge_ros",
    "probe_rmw",
    "probe_ros",
]


SOURCE: Final = ". /opt/ros/jazzy/setup.sh"
OUR_DISTRIBUTION: Final = "jazzy"
NOTE_FIXES: Final = {
    "RMW_IMPLEMENTATION": "unset RMW_IMPLEMENTATION",
    "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF": "unset ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS ": "export ROS_LOG_DIR=/tmp/ros-logs",
}
"""Prefix of one of obk's notes about the environment -> the fix."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosFacts:
    """The ROS 2 that this Python would use."""

    rclpy_folder: str | None
    """Folder from which `import rclpy` loads it; None if it is not found."""
    rclpy_version: str | None
    wheels_distribution: str | None
    """ROS distribution of the wheels; None if no wheels are installed."""
    ros_distro: str | None
    """The shell's ROS_DISTRO."""
    machine: str
    """The processor's architecture, such as `x86_64`."""
    sourceable: tuple[str, ...]
    """`setup.sh` files of ROS 2 below /opt/ros."""
    unlike_pins: Mapping[str, tuple[str, str]]
    """Distribution -> (installed, pinned) version, for ROS wheels that differ."""


def judge_ros(facts: RosFacts) -> Iterator[Finding]:
    """Report which ROS 2 is used, and version mismatches."""
    if facts.rclpy_folder is None:
        yield _missing(facts)
        return
    distribution = facts.wheels_distribution or facts.ros_distro
    source = "wheels" if facts.wheels_distribution else "a sourced ROS 2"
    yield ok(
        f"ROS 2 {distribution or 'of unknown name'} from {source}: "
        f"rclpy {facts.rclpy_version or 'of unknown version'} in {facts.rclpy_folder}",
        distribution=distribution,
        rclpy=facts.rclpy_version,
        source=source,
    )
    if facts.wheels_distribution and facts.ros_distro not in (None, facts.wheels_distribution):
        yield warning(
            f"ROS_DISTRO={facts.ros_distro}, but the wheels are {facts.wheels_distribution}: the "
            f"sourced {facts.ros_distro} is not used here, and its tools may not understand this "
            "one's messages",
            "unset ROS_DISTRO    # or use a shell in which no other ROS 2 is sourced",
            ROS_DISTRO=facts.ros_distro,
        )
    elif distribution not in (None, OUR_DISTRIBUTION):
        yield warning(
            f"ROS 2 {distribution} is not the {OUR_DISTRIBUTION} that obk is tested with",
            SOURCE,
        )
    if facts.unlike_pins:
        pairs = facts.unlike_pins.items()
        listed = ", ".join(f"{name} {is_} instead of {pin}" for name, (is_, pin) in pairs)
        yield warning(
            f"versions of ROS wheels differ from those that obk requires: {listed}",
            install_command("ros"),
        )


def _missing(facts: RosFacts) -> Finding:
    checking = "no ROS 2: this Python cannot import rclpy; configs can be checked, not launched"
    if facts.sourceable:
        return error(checking, f". {facts.sourceable[-1]}", found=facts.sourceable)
    if facts.machine == "x86_64":
        return error(checking, install_command("ros"))
    return error(
        f"{checking}; there are no ROS wheels for {facts.machine}",
        f"apt install ros-jazzy-ros-base && {SOURCE}",
        machine=facts.machine,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RmwFacts:
    """The middleware, and the network settings of ROS processes."""

    installed: tuple[str, ...]
    asked_for: str | None
    """The user's RMW_IMPLEMENTATION."""
    used: str
    domain: int | None
    """None: ROS_DOMAIN_ID is not a domain."""
    domain_fault: str
    range: str
    """ROS_AUTOMATIC_DISCOVERY_RANGE as set for stacks."""
    notes: tuple[str, ...]
    """Changes that obk makes for its processes."""


def judge_rmw(facts: RmwFacts) -> Iterator[Finding]:
    """Report the middleware, the domain and the discovery range."""
    if facts.domain is None:
        yield error(facts.domain_fault, "export ROS_DOMAIN_ID=0")
        return
    if not facts.installed:
        yield error("no ROS middleware (librmw_*.so) is installed", install_command("ros"))
        return
    yield ok(
        f"middleware {facts.used}, ROS domain {facts.domain}, discovery {facts.range}",
        rmw=facts.used,
        installed=facts.installed,
        domain=facts.domain,
        range=facts.range,
    )
    for sentence in facts.notes:
        fixes = (fix for prefix, fix in NOTE_FIXES.items() if sentence.startswith(prefix))
        yield warning(sentence, next(fixes, "unset ROS_LOCALHOST_ONLY ROS_STATIC_PEERS"))
    if facts.asked_for not in (None, "", "rmw_fastrtps_cpp") and facts.asked_for == facts.used:
        yield note(f"obk is tested with rmw_fastrtps_cpp, not with {facts.used}")


SOURCEABLE: Final = Path("/opt/ros")
_PIN: Final = re.compile(r"(?P<name>ros-[\w-]+)(?:\[\w+\])?==(?P<version>[\w.]+)")
_RMW: Final = re.compile(r"lib(?P<name>rmw_[a-z_]+(?:_cpp|_c))\.so")
_PARTS: Final = ("rmw_fastrtps_shared_cpp",)
"""Libraries that are named like a middleware but are only part of one."""


def find_rclpy() -> Path | None:
    """The folder from which rclpy would be imported."""
    spec = importlib.util.find_spec("rclpy")
    return Path(spec.origin).parent if spec and spec.origin else None


def probe_ros() -> RosFacts:
    """Find ROS 2, its source and its version."""
    rclpy = find_rclpy()
    wheels = wheels_distribution()
    version = distribution_version(f"ros_{wheels}_rclpy" if wheels else "rclpy")
    return RosFacts(
        rclpy_folder=str(rclpy) if rclpy else None,
        rclpy_version=version,
        wheels_distribution=wheels,
        ros_distro=os.environ.get("ROS_DISTRO") or None,
        machine=platform.machine(),
        sourceable=tuple(sorted(map(str, SOURCEABLE.glob("*/setup.sh")))),
        unlike_pins=dict(_unlike_pins()) if wheels else {},
    )


def _unlike_pins() -> Iterator[tuple[str, tuple[str, str]]]:
    """ROS wheels whose version differs from the one that obk pins."""
    try:
        required = importlib.metadata.requires("obelisk-cli") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for pin in filter(None, map(_PIN.match, required)):
        installed = distribution_version(pin["name"])
        if installed not in (None, pin["version"]):
            yield pin["name"], (str(installed), pin["version"])


def probe_rmw() -> RmwFacts:
    """The middleware and the network settings that processes of a stack get."""
    asked_for = os.environ.get("RMW_IMPLEMENTATION")
    installed = _installed(os.environ)
    try:
        world = ros_environment()
    except CommandFailedError as fault:
        return RmwFacts(
            installed=installed,
            asked_for=asked_for,
            used=OUR_RMW,
            domain=None,
            domain_fault=fault.message,
            range="",
            notes=(),
        )
    return RmwFacts(
        installed=installed,
        asked_for=asked_for,
        used=world.variables.get("RMW_IMPLEMENTATION") or OUR_RMW,
        domain=world.domain,
        domain_fault="",
        range=world.range,
        notes=world.notes,
    )


def _installed(environment: Mapping[str, str]) -> tuple[str, ...]:
    listed = environment.get("AMENT_PREFIX_PATH", "").split(":")
    folders = (Path(prefix) / "lib" for prefix in (*listed, sys.prefix) if prefix)
    libraries = (path.name for folder in folders for path in folder.glob("librmw_*.so"))
    names = {found["name"] for found in map(_RMW.fullmatch, libraries) if found}
    return tuple(sorted(names.difference(_PARTS)))
