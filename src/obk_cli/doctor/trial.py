"""How a program that was tried in a process of its own ended."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Trial"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A closed result: whatever the program did, this process goes on."""

    end: Literal["done", "failed", "crashed", "timed out"]
    said: str
    """Its standard output."""
    complaint: str
    """The last line of its standard error, empty where there is none."""
    signal: str = ""
    """The signal that ended it when it crashed."""
    seconds: float
    """How long it took [s]."""

    @property
    def told(self) -> str:
        """What became of it, to stand behind its name."""
        match self.end:
            case "done":
                return "worked"
            case "timed out":
                return f"gave no answer within {self.seconds:.0f} s"
            case "crashed":
                return f"was ended by {self.signal}"
            case "failed":
                return f"failed: {self.complaint or 'it said nothing'}"
