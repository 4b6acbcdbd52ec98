"""What happens during a run, as values, and how it is published.

Input events reach the supervisor through its inbox; output events are what it publishes: to the
journal, the screen, the recorder, the state node. The names of output events stand in
`events.jsonl` and in the JSON stream, so they are a promise (see `OUTPUT_EVENTS`).
"""

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Generic, TypeVar, get_args

from obelisk_spec.runtime_protocol import Rate
from obelisk_spec.video import VideoStatus
from obk_cli.runs.protocol import ChangeAnswer, Result, StackStatus

__all__ = [
    "OUTPUT_EVENTS",
    "ActivationReported",
    "Answered",
    "AnswersAgain",
    "ChangeRequested",
    "Ended",
    "EventBus",
    "EventPublisher",
    "Evidence",
    "Failed",
    "GoesOnWithout",
    "Hung",
    "InputEvent",
    "OutputEvent",
    "OutputLine",
    "Phase",
    "ProcessEnded",
    "ProcessStarted",
    "RateBroken",
    "RateKept",
    "RateMoved",
    "RatesReported",
    "RatesUnreported",
    "Ready",
    "RejectionReported",
    "Restarted",
    "Restarting",
    "StackStateChanged",
    "StateAnswered",
    "StateSeen",
    "StatusRequested",
    "StopRequested",
    "TransitionEnded",
    "TransitionStarted",
    "UnknownPublisherFound",
    "VideoReported",
    "WaitingFor",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeRequested:
    """A request to take nodes through a transition; answered once, at the latest at the end."""

    transition: str
    reply: Callable[[ChangeAnswer], None]
    """May be called from any thread; must return at once."""
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: float | None = None
    """For each node's transition [s]; None: the launch's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusRequested:
    """A request for the state of the stack; answered at once, also during a transition."""

    reply: Callable[[StackStatus], None]


if TYPE_CHECKING:
    from obk_cli.launch.stack_state import StackState


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStarted:
    """A process runs; `process` is the name of its unit."""

    process: str
    pid: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessEnded:
    """A process has ended; `code` is negative for the signal that ended it."""

    process: str
    code: int
    text: str = ""
    """The reason if known: why it could not start, or its last output line; otherwise empty."""

    @property
    def how(self) -> str:
        """How it ended, as a sentence."""
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
    """The node's own account of the fault; otherwise empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateAnswered:
    """A node answered the question for its state."""

    node: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSeen:
    """A node reported a resting state; comes later than the answer, if at all."""

    node: str
    state: str
    transition: str = ""
    """What led there, requested here or elsewhere; empty for the way out of error processing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionStarted:
    """A node reported the start of a transition, requested here or elsewhere."""

    node: str
    transition: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A node went to error processing."""

    node: str
    fault: str
    transition: str = ""
    """The one that failed, requested here or elsewhere; empty when the node failed by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RatesReported:
    """A node reported its measured rates."""

    node: str
    rates: tuple[Rate, ...]
    is_external: bool = False
    """Whether the launcher measured them on the node's topics."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActivationReported:
    """A node with simulated time reported when it became active."""

    node: str
    simulated_s: float
    """Simulated time [s]."""
    first_output_s: float | None = None
    """When it published for the first time then; None: not in the second after it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectionReported:
    """A robot receives commands and has rejected all of them for some time."""

    node: str
    seconds: float
    """0: it accepts them again [s]."""
    reason: str
    """Why the newest command was rejected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoReported:
    """A simulated robot reported the status of its video."""

    node: str
    video: VideoStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownPublisherFound:
    """A node that is not part of the stack publishes on a topic that moves its robot."""

    topic: str
    node: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRequested:
    """The user, or the program that runs the launcher, requests the end of the stack."""

    reason: str
    is_urgent: bool = False
    """Whether a further request means that it does not go fast enough."""


InputEvent = (
    ProcessStarted
    | ProcessEnded
    | Ready
    | Answered
    | StateAnswered
    | StateSeen
    | TransitionStarted
    | Failed
    | RatesReported
    | ActivationReported
    | RejectionReported
    | VideoReported
    | ChangeRequested
    | StatusRequested
    | UnknownPublisherFound
    | StopRequested
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
    """The stack as a whole reached a phase: `starting`, `ready`, `active`, `stopping`, ..."""

    name: str
    seconds: float
    """Since the launch [s]."""
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackStateChanged:
    """The state of the stack as a whole has changed: `inactive`, `activating`."""

    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Hung:
    """A node's process runs, and the node has not answered for `seconds`."""

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
    """Nodes are lost, and the stack runs on according to its rules."""

    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateBroken:
    """An expected rate has been missed for 2 s, or is not reported any more."""

    node: str
    rate: Rate
    origin: str
    """The place of the period in the config, `file:line:column`; empty where it has none."""
    silent_s: float = 0.0
    """How long the node has not reported [s]; 0: it has just done so."""

    @property
    def how(self) -> str:
        """What is wrong, as a sentence."""
        rate = self.rate
        if self.silent_s:
            how = f"{rate.name} was not reported for {self.silent_s:.1f} s, "
            how += f"expected {rate.expected_hz:.4g} Hz"
        elif rate.late_p99_us:
            how = f"{rate} (p99 latency {rate.late_p99_us / 1e3:.3g} ms)"
        else:  # its ticks are the simulator's, which are never late for it
            how = str(rate)
        return f"{how}; set at {self.origin}" if self.origin else how


@dataclass(frozen=True, slots=True, kw_only=True)
class RatesUnreported:
    """An active node does not report its rates, as nodes in C++ do not.

    The launcher measures those that a topic shows.
    """

    node: str
    measured: tuple[str, ...]
    """Names of the rates that are measured on topics."""
    unknown: tuple[str, ...]
    """Names of the others."""

    @property
    def how(self) -> str:
        """What is not known, as a sentence."""
        unknown = f"; not measured: {', '.join(self.unknown)}" if self.unknown else ""
        measured = f"; measured on its topics: {', '.join(self.measured)}" if self.measured else ""
        return f"it does not report its rates{measured}{unknown}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RateKept:
    """A rate that was broken is as expected again."""

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
    """The last lines of a stuck node's process, its stack dump among them."""

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


OutputEvent = (
    ProcessStarted
    | ProcessEnded
    | StateSeen
    | Failed
    | TransitionEnded
    | Phase
    | StackStateChanged
    | Hung
    | AnswersAgain
    | Restarting
    | Restarted
    | GoesOnWithout
    | RateBroken
    | RatesUnreported
    | RateKept
    | RateMoved
    | WaitingFor
    | Evidence
    | ActivationReported
    | VideoReported
    | Ended
)


OUTPUT_EVENTS: Final[Mapping[str, type[OutputEvent]]] = {
    "StackState" if kind is StackStateChanged else kind.__name__: kind
    for kind in get_args(OutputEvent)
}
"""Name in `events.jsonl` and in the JSON stream -> event."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputLine:
    """A line that a process wrote."""

    process: str
    """The name of its unit."""
    text: str


E = TypeVar("E")


class EventBus(Generic[E]):
    """Hands each event to all subscribers, in the order in which they subscribed."""

    def __init__(self) -> None:
        self._subscribers: list[Callable[[E], None]] = []

    def subscribe(self, subscriber: Callable[[E], None]) -> None:
        """Call `subscriber` with each event, in the publishing thread; only before the first."""
        self._subscribers.append(subscriber)

    def publish(self, event: E) -> None:
        """Hand an event to all subscribers."""
        for subscriber in self._subscribers:
            subscriber(event)


class EventPublisher:
    """Publishes the output events of one run, and the stack's state as it changes with them."""

    def __init__(
        self,
        state: "StackState",
        clock: Callable[[], float],
        publish: Callable[[OutputEvent], None],
    ) -> None:
        """Start the time of the run.

        Args:
            state: of the stack.
            clock: monotonic time [s].
            publish: takes the events.
        """
        self._state = state
        self._clock = clock
        self._publish = publish
        self._begin = clock()
        self._phase = ""
        self._published_state = ""

    def publish(self, event: OutputEvent) -> None:
        """Publish an event, and the stack's state if it has changed with it."""
        self._publish(event)
        self.publish_state()

    def publish_state(self) -> None:
        """Publish the stack's state if it has changed."""
        state = self._state.summary()
        if state != self._published_state:
            self._published_state = state
            self._publish(StackStateChanged(state=state))

    def phase(self, name: str, detail: str = "") -> None:
        """The stack reached a phase."""
        self._phase = name
        self.episode(name, detail)

    def episode(self, name: str, detail: str = "") -> None:
        """Something happens after which the stack is in the same phase as before."""
        self.publish(Phase(name=name, seconds=self._clock() - self._begin, detail=detail))

    def in_transition(self, passes: str) -> None:
        """Set the state shown for the whole stack during a transition; empty: that of its nodes."""
        self._state.moving = passes
        self.publish_state()

    def status(self) -> StackStatus:
        """The stack's status."""
        return StackStatus(
            name=self._state.plan.name,
            state=self._state.summary(),
            phase=self._phase,
            seconds=self._clock() - self._begin,
            nodes=self._state.status(),
        )


def _signal_name(number: int) -> str:
    """`SIGINT`; those for real-time use have no name of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
