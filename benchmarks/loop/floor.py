"""Compile the C program in `benchmarks/floor` with the ROS 2 of this Python environment."""

import subprocess
import sys
import sysconfig
from pathlib import Path

from obk_interfaces.prefix import find_ros_prefix, include_folders
from obk_interfaces.toolchain import find_compilers

__all__ = ["build_floor"]

SOURCE = Path(__file__).resolve().parents[1] / "floor" / "floor.c"
MESSAGES = ("obelisk_control_msgs", "obelisk_estimator_msgs", "obelisk_sensor_msgs")
MESSAGE_LIBRARIES = ("rosidl_typesupport_c", "rosidl_generator_c")
LIBRARIES = (
    *("rcl", "rcutils", "rosidl_runtime_c"),
    *(f"{message}__{library}" for message in MESSAGES for library in MESSAGE_LIBRARIES),
)


def build_floor(folder: Path) -> Path:
    """Compile the program and return its path.

    Args:
        folder: the output folder.

    Raises:
        BuildToolError: no compiler or no ROS 2 was found.
        CalledProcessError: compilation failed; the compiler has printed the reason.
    """
    (compiler, _), program = find_compilers(), folder / "floor"
    prefixes = tuple(dict.fromkeys((Path(sys.prefix), find_ros_prefix())))
    libraries = [prefix / "lib" for prefix in prefixes]
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(
        [
            *compiler,
            *("-std=gnu11", "-O2", "-Wall", "-Wextra"),
            *("-o", str(program), str(SOURCE)),
            # System headers, to suppress warnings of newer compilers about ROS 2 headers.
            *(f"-isystem{include}" for include in include_folders(prefixes)),
            *(f"-L{library}" for library in libraries),
            *(f"-l{library}" for library in LIBRARIES),
            # Their dependencies are found at run time, as set up by the start hook of Python.
            "-Wl,--allow-shlib-undefined",
            *_python(),
        ],
        check=True,
    )
    return program


def _python() -> tuple[str, ...]:
    """Linker flags for libpython, whose symbols librcl from the wheels needs to load."""
    folder = sysconfig.get_config_var("LIBDIR")
    library = f"-lpython{sysconfig.get_config_var('LDVERSION')}"
    return (f"-L{folder}", f"-Wl,-rpath,{folder}", "-Wl,--no-as-needed", library)
