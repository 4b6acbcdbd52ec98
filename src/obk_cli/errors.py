"""Faults of the surroundings, not of the config: a missing file, a bad option.

They are raised, and the command line turns each into one message and an exit code.
"""

from typing import Final

__all__ = [
    "EXIT_DONE",
    "EXIT_FAILED",
    "EXIT_INTERRUPTED",
    "EXIT_MISUSE",
    "CommandFailedError",
    "MisuseError",
    "ObkError",
]

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
EXIT_MISUSE: Final = 2
EXIT_INTERRUPTED: Final = 130


class ObkError(Exception):
    """What was asked for cannot be done; the message is for the user."""

    exit_code: int = EXIT_FAILED

    def __init__(self, message: str, *, help: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.help = help


class MisuseError(ObkError):
    """The command line itself is wrong: an option's value, a combination."""

    exit_code = EXIT_MISUSE


class CommandFailedError(ObkError):
    """A command ran and failed for a reason outside the config."""
