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
    "StateAnswered",
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
            end = f"the process was ended by {_signal_name(-self.code)}"
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
class StateAnswered:
    """A node answered the question for its state."""

    node: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSeen:
    """A node said that it reached a resting state; comes later than the answer, if at all."""

    node: str
    state: str
    transition: str = ""
    """What led there, whoever asked for it; empty for the way out of error processing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A node went to error processing."""

    node: str
    fault: str
    transition: str = ""
    """The one that failed, whoever asked for it; empty when the node failed by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAsked:
    """The user, or whoever runs us, wants the stack down."""

    reason: str
    is_urgent: bool = False
    """Whether asking once more means that it does not go fast enough."""


Heard = (
    ProcessStarted
    | ProcessEnded
    | Ready
    | Answered
    | StateAnswered
    | StateSeen
    | Failed
    | StopAsked
)


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


def _signal_name(number: int) -> str:
    """`SIGINT`; those for real-time use have no name of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
