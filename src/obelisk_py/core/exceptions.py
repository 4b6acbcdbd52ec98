"""The errors that the run-time library raises, and that nodes may raise themselves.

If a callback raises one of these, its sentence is logged, without a traceback.
"""

__all__ = ["ObeliskConfigError", "ObeliskError", "ObeliskHardwareError", "ObeliskMsgError"]


class ObeliskError(Exception):
    """Base of the library's own errors."""


class ObeliskConfigError(ObeliskError, ValueError):
    """The node's settings cannot be used: something is missing, unknown or contradicts the code.

    It is a `ValueError` for existing code, which catches that.
    """


class ObeliskHardwareError(ObeliskError):
    """A device does not answer, or not as it should; raised by nodes that drive hardware."""


class ObeliskMsgError(ObeliskError):
    """A message type is unknown, not installed, or not the one that code or config names."""

    @property
    def msg(self) -> str:
        """The message; kept for existing code."""
        return str(self)
