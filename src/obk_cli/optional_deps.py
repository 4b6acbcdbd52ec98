"""Check which distributions are installed, and require the extras that a command needs.

Only folder names are read: that is much faster than metadata, and imports nothing.
"""

import importlib.util
import os
import platform
import re
import sys
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from obk_cli.errors import CommandFailedError

__all__ = [
    "distribution_version",
    "how_to_install_ros",
    "no_ros",
    "require_extra",
    "require_ros",
    "run_versions",
    "wheels_distribution",
]


def require_extra(module: str, extra: str) -> None:
    """Raise an error if a library is not installed.

    Args:
        module: the name by which the library is imported.
        extra: the extra of `obelisk-cli` that installs it.

    Raises:
        CommandFailedError: the library is not installed.
    """
    if importlib.util.find_spec(module) is None:
        raise CommandFailedError(
            f"the library `{module}` is not installed", help=f"install it with {_install(extra)}"
        )


def require_ros() -> None:
    """Raise an error if rclpy is not installed.

    Raises:
        CommandFailedError: rclpy is not installed.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise no_ros("the library `rclpy` is not installed")


def no_ros(why: object) -> CommandFailedError:
    """The error for a command that needs ROS 2.

    Args:
        why: the reason why ROS 2 cannot be used.
    """
    return CommandFailedError(f"ROS 2 is not available: {why}", help=how_to_install_ros())


def how_to_install_ros() -> str:
    """The help for anything that needs ROS 2."""
    return f"install it with {_install('ros')} (x86-64), or source a ROS 2 setup file"


def _install(extra: str) -> str:
    # Only needed for an error: importing the metadata of distributions takes a long time.
    from obk_cli.install_source import install_command

    return f"`{install_command(extra)}`"


_INFO = re.compile(r"([^-]+)-(.+?)(?:-py[\d.]+)?\.(?:dist|egg)-info")
_RCLPY_WHEEL = re.compile(r"ros_([a-z]+)_rclpy")


def distribution_version(name: str) -> str | None:
    """The version of an installed distribution, None if it is not installed."""
    return _versions(tuple(sys.path)).get(_normal(name))


def wheels_distribution() -> str | None:
    """The ROS distribution of the installed wheels, `jazzy`; None if no wheels are installed."""
    wheels = (_RCLPY_WHEEL.fullmatch(name) for name in _versions(tuple(sys.path)))
    return next((wheel[1] for wheel in wheels if wheel), None)


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "_", name).lower()


@lru_cache(maxsize=4)
def _versions(folders: tuple[str, ...]) -> Mapping[str, str]:
    versions: dict[str, str] = {}
    for folder in folders:
        try:
            names = [path.name for path in Path(folder).iterdir()]
        except OSError:
            continue
        for name in names:
            info = _INFO.fullmatch(name)
            if info:
                versions.setdefault(_normal(info[1]), info[2])
    return versions


def run_versions() -> Mapping[str, str]:
    """Versions of obk, Python, rclpy and MuJoCo, and the ROS distribution, as far as installed.

    It does not import them.
    """
    wheels = wheels_distribution()
    found = {
        "obk": distribution_version("obelisk-cli"),
        "python": platform.python_version(),
        "mujoco": distribution_version("mujoco"),
        "rclpy": distribution_version(f"ros_{wheels}_rclpy" if wheels else "rclpy"),
        "ros": wheels or os.environ.get("ROS_DISTRO"),
    }
    return {name: version for name, version in found.items() if version}
