"""The ROS 2 and the middleware that this Python would use; nothing of them is imported."""

import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from obk_cli.doctor.ros import RmwFacts, RosFacts
from obk_cli.errors import CommandFailedError
from obk_cli.optional_deps import distribution_version, distributions_like
from obk_cli.ros.environment import OUR_RMW, ros_environment

__all__ = ["find_rclpy", "probe_rmw", "probe_ros", "wheels_distribution"]

SOURCEABLE: Final = Path("/opt/ros")
_PIN: Final = re.compile(r"(?P<name>ros-[\w-]+)(?:\[\w+\])?==(?P<version>[\w.]+)")
_RMW: Final = re.compile(r"lib(?P<name>rmw_[a-z_]+(?:_cpp|_c))\.so")
_PARTS: Final = ("rmw_fastrtps_shared_cpp",)
"""Libraries that are named like a middleware and are a part of one."""


def find_rclpy() -> Path | None:
    """The folder of the rclpy that would be imported."""
    spec = importlib.util.find_spec("rclpy")
    return Path(spec.origin).parent if spec and spec.origin else None


def wheels_distribution() -> str | None:
    """The ROS distribution of the installed wheels, None where there are none."""
    wheels = distributions_like(r"ros_[a-z]+_rclpy")
    return next((name.split("_")[1] for name in wheels), None)


def probe_ros() -> RosFacts:
    """Where ROS 2 comes from, and which one it is."""
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
    """The ROS wheels whose version is not the one that this obk asks for."""
    try:
        wanted = importlib.metadata.requires("obelisk-cli") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for pin in filter(None, map(_PIN.match, wanted)):
        installed = distribution_version(pin["name"])
        if installed not in (None, pin["version"]):
            yield pin["name"], (str(installed), pin["version"])


def probe_rmw() -> RmwFacts:
    """The middleware, and the network as ROS processes of a stack are told of it."""
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
