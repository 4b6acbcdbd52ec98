"""The error of a recording that cannot be read; imports nothing."""

__all__ = ["RecordingError"]


class RecordingError(LookupError):
    """A recording cannot be read, or has no such topic or field; the message is for the user."""

    exit_code = 1

    def __init__(self, message: str, *, help: str | None = None) -> None:
        super().__init__(f"{message}: {help}" if help else message)
        self.message = message
        self.help = help
