"""The versions that a run was made with, for whoever looks at it later."""

import os
import platform
from collections.abc import Mapping

from obk_cli.adapters.distributions import distribution_version, distributions_like

__all__ = ["run_versions"]


def run_versions() -> Mapping[str, str]:
    """Versions of obk, Python, rclpy and MuJoCo, and the ROS distribution, as far as they are here.

    Nothing is imported for it.
    """
    wheels = distributions_like(r"ros_[a-z]+_rclpy")
    found = {
        "obk": distribution_version("obelisk-cli"),
        "python": platform.python_version(),
        "mujoco": distribution_version("mujoco"),
        "rclpy": next(iter(wheels.values()), None) or distribution_version("rclpy"),
        "ros": next((name.split("_")[1] for name in wheels), None) or os.environ.get("ROS_DISTRO"),
    }
    return {name: version for name, version in found.items() if version}
