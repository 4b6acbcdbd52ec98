"""Builds ROS 2 message packages for the running Python, without CMake and without ament.

In go folders with a `package.xml` and `msg/`, `srv/` or `action/`; out comes a prefix with
`lib/`, `include/` and `share/` that rclpy can use. Works against the ROS 2 wheels of the
environment and against a sourced ROS 2. Never prints and never leaves a half-built package
in the prefix.
"""

from obk_interfaces.build import BuildReport, Progress, ProgressCallback, build, digest_of
from obk_interfaces.errors import (
    BuildToolError,
    CommandError,
    DefinitionError,
    DependencyError,
    InterfaceError,
    PackageError,
    Problem,
)
from obk_interfaces.package import (
    KINDS,
    Interface,
    InterfacePackage,
    definition_files,
    discover,
    load_package,
    order_by_dependency,
)
from obk_interfaces.prefix import Prefixes, find_ros_prefix, remove_package

__all__ = [
    "KINDS",
    "BuildReport",
    "BuildToolError",
    "CommandError",
    "DefinitionError",
    "DependencyError",
    "Interface",
    "InterfaceError",
    "InterfacePackage",
    "PackageError",
    "Prefixes",
    "Problem",
    "Progress",
    "ProgressCallback",
    "build",
    "definition_files",
    "digest_of",
    "discover",
    "find_ros_prefix",
    "load_package",
    "order_by_dependency",
    "remove_package",
]
