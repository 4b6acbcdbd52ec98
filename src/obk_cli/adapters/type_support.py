"""Whether generated classes can go over the wire here: whether their compiled part is loaded."""

from collections.abc import Callable
from typing import Any

from obk_cli.errors import CommandFailedError

__all__ = ["require_message", "require_service"]


def require_message(python_type: Any) -> None:
    """Make sure that messages of a class can be sent and heard.

    Raises:
        CommandFailedError: they cannot.
    """
    from rclpy.type_support import check_is_valid_msg_type

    _require(check_is_valid_msg_type, python_type)


def require_service(python_type: Any) -> None:
    """Make sure that services of a class can be called.

    Raises:
        CommandFailedError: they cannot.
    """
    from rclpy.type_support import check_is_valid_srv_type

    _require(check_is_valid_srv_type, python_type)


def _require(check: Callable[[Any], Any], python_type: Any) -> None:
    try:
        check(python_type)
    except Exception as error:  # whatever a generated package may raise
        package, section, *_ = f"{python_type.__module__}.".split(".")
        raise CommandFailedError(
            f"the type {package}/{section}/{python_type.__name__} cannot be used here: {error}",
            help="its package is built for another Python or ROS 2: build it anew, or leave that "
            "out of PYTHONPATH",
        ) from error
