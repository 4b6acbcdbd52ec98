"""Check the prerequisites of `make setup`.

It checks the running Python and the chosen ROS 2 (`wheels` or `system`). Exit code 1 if anything is
missing, with one message for each missing thing. It never installs anything. This file is valid in
any Python 3, so that an old Python gives a message and not a syntax error.
"""

import importlib.util
import os
import sys


def version_fault():
    """Return a message if this Python's version is not supported, otherwise an empty string."""
    if (3, 11) <= sys.version_info[:2] <= (3, 13):
        return ""
    return (
        "%s is Python %d.%d: Obelisk needs 3.11, 3.12 or 3.13. "
        "Choose another one with: make setup PYTHON=/path/to/python3"
        % (sys.executable, sys.version_info[0], sys.version_info[1])
    )


def venv_fault():
    """Return a message if this Python cannot create virtual environments."""
    if importlib.util.find_spec("ensurepip") and importlib.util.find_spec("venv"):
        return ""
    return "%s cannot create virtual environments (Debian, Ubuntu: apt install python3-venv)" % (
        sys.executable
    )


def ros_fault(ros):
    """Return a message if the chosen ROS 2 cannot be used."""
    if ros == "wheels":
        machine = os.uname().machine
        if machine == "x86_64":
            return ""
        return (
            "no ROS 2 wheels exist for %s: install ROS 2 Jazzy, source it, "
            "and run: make setup ROS=system" % machine
        )
    if ros != "system":
        return "unknown value ROS=%s: use ROS=wheels (the default) or ROS=system" % ros
    if not os.environ.get("AMENT_PREFIX_PATH"):
        return (
            "ROS=system, but no ROS 2 is sourced (AMENT_PREFIX_PATH is empty): "
            "run first: . /opt/ros/jazzy/setup.sh"
        )
    if importlib.util.find_spec("rclpy") is None:
        return (
            "ROS=system, but %s cannot import rclpy: use the Python that the sourced ROS 2 was "
            "built for, with: make setup ROS=system PYTHON=/usr/bin/python3" % sys.executable
        )
    return ""


def compiler_fault():
    """Return a message if the message packages cannot be compiled."""
    sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(__file__)), "src"))
    from obk_interfaces import BuildToolError
    from obk_interfaces.toolchain import find_compilers, find_python_headers

    try:
        find_compilers()
        find_python_headers()
    except BuildToolError as error:
        return str(error)
    return ""


def main():
    """Print all messages; return the exit code."""
    ros = sys.argv[1] if len(sys.argv) > 1 else "wheels"
    faults = [version_fault()]
    if not faults[0]:
        faults += [venv_fault(), ros_fault(ros), compiler_fault()]
    for fault in filter(None, faults):
        sys.stderr.write("make setup: %s\n" % fault)
    return int(any(faults))


if __name__ == "__main__":
    sys.exit(main())
