"""What happens during a run, as values: what the supervisor hears, and what it tells."""

import signal
from dataclasses import dataclass

from obelisk_spec.rates import Rate
from obk_cli.launch.asks import ChangeAsked, StatusAsked
from obk_cli.runs.protocol import Result

__all__ = [
    "Answered",
    "AnswersAgain",
    "Ended",
    "Evidence",
    "Failed",
    "GoesOnWithout",
    "Heard",
    "Hung",
    "Phase",
    "ProcessEnded",
    "ProcessStarted",
    "RateBroken",
    "RateKept",
    "RateMoved",
    "RatesHeard",
    "Ready",
    "Restarted",
    "Restarting",
    "Result",
    "StackState",
    "StateAnswered",
    "StateSeen",
    "StopAsked",
    "StrangerSeen",
    "Told",
    "TransitionBegun",
    "TransitionEnded",
    "WaitingFor",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStarted:
    """A process runs; `process` is the name of its unit."""

    process: str
    pid: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessEnded:
    """A process is no more; `code` is negative for the signal that ended it."""

    process: str
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
class TransitionBegun:
    """A node said that it is in the middle of a transition, whoever asked for it."""

    node: str
    transition: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A node went to error processing."""

    node: str
    fault: str
    transition: str = ""
    """The one that failed, whoever asked for it; empty when the node failed by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RatesHeard:
    """A node reported how it keeps its promises."""

    node: str
    rates: tuple[Rate, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StrangerSeen:
    """A node that is not the stack's publishes on a topic that moves its robot."""

    topic: str
    node: str


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
    | TransitionBegun
    | Failed
    | RatesHeard
    | ChangeAsked
    | StatusAsked
    | StrangerSeen
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
class StackState:
    """The state of the stack as a whole, each time that it changes: `inactive`, `activating`."""

    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Hung:
    """A node's process is there, and the node has not answered for `seconds`."""

    node: str
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswersAgain:
    """A node that hung answers."""

    node: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Restarting:
    """Nodes that crashed are started again after a wait [s]."""

    nodes: tuple[str, ...]
    wait_s: float
    attempt: int
    """From 1, within the window in which restarts are counted."""
    attempts: int
    """How many there may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Restarted:
    """Nodes that crashed are back where they were."""

    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GoesOnWithout:
    """Nodes are lost, and the stack runs on as its rules say."""

    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateBroken:
    """A promised rate has been missed for 2 s, or nothing is said of it any more."""

    node: str
    rate: Rate
    origin: str
    """The place of the period in the config, `file:line:column`; empty where it has none."""
    silent_s: float = 0.0
    """How long the node has not reported [s]; 0: it has just done so."""

    @property
    def how(self) -> str:
        """What is wrong in words."""
        rate = self.rate
        if self.silent_s:
            how = f"{rate.name} is promised at {rate.wanted_hz:.4g} Hz, "
            how += f"and nothing was reported for {self.silent_s:.1f} s"
        elif rate.late_p99_us:
            how = f"{rate}, 99 % of its ticks at most {rate.late_p99_us / 1e3:.3g} ms late"
        else:  # its ticks are the simulator's, which are never late for it
            how = str(rate)
        return f"{how}; promised at {self.origin}" if self.origin else how


@dataclass(frozen=True, slots=True, kw_only=True)
class RateKept:
    """A promise that was broken is kept again."""

    node: str
    rate: Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class RateMoved:
    """A rate is off or broken and not what it was, or it is no longer off."""

    node: str
    rate: Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingFor:
    """The bring-up waits for nodes of other devices, which are started elsewhere."""

    devices: tuple[str, ...]
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The last lines of a process's output, its stack dump among them, where a node is stuck."""

    node: str
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """The end of the run."""

    exit_code: int
    cause: str
    """The first cause of a failure; empty when all went well."""
    consequences: int = 0
    """Further failures that came after the first."""
    origin: str = ""
    """The place in the config, `file:line:column`, that made the node which failed first."""


Told = (
    ProcessStarted
    | ProcessEnded
    | StateSeen
    | Failed
    | TransitionEnded
    | Phase
    | StackState
    | Hung
    | AnswersAgain
    | Restarting
    | Restarted
    | GoesOnWithout
    | RateBroken
    | RateKept
    | RateMoved
    | WaitingFor
    | Evidence
    | Ended
)


def _signal_name(number: int) -> str:
    """`SIGINT`; those for real-time use have no name of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
