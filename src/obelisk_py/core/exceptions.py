"""The errors that the run-time library raises."""

__all__ = ["ObeliskConfigError", "ObeliskError", "ObeliskMsgError"]


class ObeliskError(Exception):
    """Base of the library's own errors."""


class ObeliskConfigError(ObeliskError):
    """The node's settings cannot be used: something is missing, unknown or contradicts the code."""


class ObeliskMsgError(ObeliskError):
    """A message type is unknown, not installed, or not the one that code or config names."""
