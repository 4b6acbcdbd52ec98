"""The errors that the runtime library raises and that nodes may raise themselves.

If a callback raises one of these, the node logs its message without a traceback.
"""

__all__ = ["ObeliskConfigError", "ObeliskError", "ObeliskHardwareError", "ObeliskMsgError"]


class ObeliskError(Exception):
    """Base class of the library's errors."""


class ObeliskConfigError(ObeliskError, ValueError):
    """A setting of the node is missing, unknown or contradicts the code.

    It is a `ValueError` because existing code catches that.
    """


class ObeliskHardwareError(ObeliskError):
    """A device does not respond or responds incorrectly; raised by nodes that drive hardware."""


class ObeliskMsgError(ObeliskError):
    """A message type is unknown, not installed, or differs from the type in the code or config."""

    @property
    def msg(self) -> str:
        """The message; kept for existing code."""
        return str(self)
