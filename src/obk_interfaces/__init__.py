"""Build ROS 2 message packages for the running Python, without CMake or ament.

`build` takes folders with a `package.xml` and `msg/`, `srv/` or `action/`. It installs `lib/`,
`include/` and `share/` to a prefix that rclpy can use. It supports the ROS 2 wheels of the
environment and a sourced ROS 2. It prints nothing and never installs a package partially.
"""

from obk_interfaces.build import BuildReport, Progress, ProgressCallback, build, digest_of
from obk_interfaces.errors import (
    BuildToolError,
    CommandError,
    DefinitionError,
    DefinitionProblem,
    DependencyError,
    InterfaceError,
    NoRosError,
    PackageError,
)
from obk_interfaces.package import (
    KINDS,
    Interface,
    InterfacePackage,
    cmake_calls,
    definition_files,
    discover,
    load_package,
    missing_definitions,
    order_by_dependency,
)
from obk_interfaces.prefix import Prefixes, find_ros_prefix, remove_package

__all__ = [
    "KINDS",
    "BuildReport",
    "BuildToolError",
    "CommandError",
    "DefinitionError",
    "DefinitionProblem",
    "DependencyError",
    "Interface",
    "InterfaceError",
    "InterfacePackage",
    "NoRosError",
    "PackageError",
    "Prefixes",
    "Progress",
    "ProgressCallback",
    "build",
    "cmake_calls",
    "definition_files",
    "digest_of",
    "discover",
    "find_ros_prefix",
    "load_package",
    "missing_definitions",
    "order_by_dependency",
    "remove_package",
]
