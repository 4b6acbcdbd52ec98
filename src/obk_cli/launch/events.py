"""What happens during a run, as values: what the supervisor hears, and what it tells."""

import signal
from dataclasses import dataclass
from typing import Literal

__all__ = [
    "Answered",
    "Ended",
    "Failed",
    "Heard",
    "Phase",
    "ProcessEnded",
    "ProcessStarted",
    "Ready",
    "Result",
    "StateSeen",
    "StopAsked",
    "Told",
    "TransitionEnded",
]

Result = Literal["reached", "refused", "timed out", "gone"]
"""How a transition ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStarted:
    """A node's process runs."""

    node: str
    pid: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessEnded:
    """A node's process is no more; `code` is negative for the signal that ended it."""

    node: str
    code: int
    text: str = ""
    """What is known of the reason: why it could not start, or its last words; else empty."""

    @property
    def how(self) -> str:
        """The end in words."""
        if self.code < 0:
            end = f"the process was ended by {signal.Signals(-self.code).name}"
        else:
            end = f"the process exited with code {self.code}"
        return f"{end}: {self.text}" if self.text else end


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A node's life-cycle services answer."""

    node: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """A node answered a transition request."""

    node: str
    transition: str
    success: bool
    fault: str
    """The node's own words on what went wrong, else empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSeen:
    """A node said that it reached a resting state."""

    node: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A node went to error processing without being asked for anything."""

    node: str
    fault: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAsked:
    """The user, or whoever runs us, wants the stack down."""

    reason: str


Heard = ProcessStarted | ProcessEnded | Ready | Answered | StateSeen | Failed | StopAsked


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionEnded:
    """One node's part of a step, with the time that it took [s]."""

    node: str
    transition: str
    result: Result
    seconds: float
    fault: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """The stack as a whole got somewhere: `starting`, `ready`, `active`, `stopping`, ..."""

    name: str
    seconds: float
    """Since the launch [s]."""
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """The end of the run."""

    exit_code: int
    cause: str
    """The first cause of a failure; empty when all went well."""
    consequences: int = 0
    """Further failures that came after the first."""


Told = ProcessStarted | ProcessEnded | StateSeen | Failed | TransitionEnded | Phase | Ended
