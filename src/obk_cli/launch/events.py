"""The input and output events of a run, and how they are published.

Input events reach the supervisor through its inbox. Output events are published to the journal, the
screen, the recorder and the state node. Their names appear in `events.jsonl` and in the JSON
stream, so they must not change (see `OUTPUT_EVENTS`).
"""

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Generic, TypeVar, get_args

from obelisk_spec.runtime_protocol import Rate, hz
from obelisk_spec.video import VideoStatus
from obk_cli.runs.protocol import ChangeAnswer, Result, StackStatus

__all__ = [
    "FAULT_TRANSITIONS",
    "OUTPUT_EVENTS",
    "SIGNAL_EXIT",
    "UNKNOWN_FAULT",
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
    "PageReported",
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
    "SignalIgnored",
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


SIGNAL_EXIT: Final = 128
"""A program that handles a signal and then exits adds the signal's number to this exit code."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeRequested:
    """A request to take nodes through a transition; answered once, at the latest at shutdown."""

    transition: str
    reply: Callable[[ChangeAnswer], None]
    """May be called from any thread; must return at once."""
    nodes: tuple[str, ...] = ()
    """Full names; empty: the whole stack."""
    timeout_s: float | None = None
    """Limit for each node's transition [s]; None: the limit set at launch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusRequested:
    """A request for the state of the stack; answered at once, even during a transition."""

    reply: Callable[[StackStatus], None]


if TYPE_CHECKING:
    from obk_cli.launch.stack_state import StackState


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessStarted:
    """A process has started."""

    process: str
    pid: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessEnded:
    """A process has ended; a negative `code` is the number of the signal that ended it."""

    process: str
    code: int
    text: str = ""
    """Why it could not start, or its last output line; empty if unknown."""

    @property
    def how(self) -> str:
        """How the process ended, as a sentence."""
        if self.code in (-signal.SIGTERM, SIGNAL_EXIT + signal.SIGTERM):
            # Someone requested that, so the last output is not the reason.
            return "the process was terminated by SIGTERM"
        if self.code < 0:
            end = f"the process was terminated by {_signal_name(-self.code)}"
        else:
            end = f"the process exited with code {self.code}"
        return f"{end}: {self.text}" if self.text else end


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """A node's lifecycle services answer."""

    node: str
    state: str
    """The state in the answer; not `unconfigured` if someone else has already changed it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """A node answered a transition request."""

    node: str
    transition: str
    success: bool
    fault: str
    """The fault as the node reported it; otherwise empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateAnswered:
    """A node answered a query for its state."""

    node: str
    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSeen:
    """A node reported a resting state; arrives after the transition's response, if at all."""

    node: str
    state: str
    transition: str = ""
    """The transition that led there; empty after error processing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionStarted:
    """A node reported the start of a transition, requested here or elsewhere."""

    node: str
    transition: str


UNKNOWN_FAULT: Final = "the node did not answer a query for its fault"
"""Replaces the fault of a node that is probably still busy with `on_error`."""
FAULT_TRANSITIONS: Final = ("deactivate", "cleanup")
"""The transitions through which a node that fails outside a transition enters error processing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """A node entered error processing."""

    node: str
    fault: str
    """As the node reported it, or that it did not; empty if the node cannot report faults."""
    transition: str = ""
    """The transition that failed; empty if the node failed outside a transition."""


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
    """Simulated time of the first message; None: none within a second of activation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectionReported:
    """A robot receives commands and has rejected all of them for some time."""

    node: str
    seconds: float
    """[s]; 0: it accepts commands again."""
    reason: str
    """Why the latest command was rejected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoReported:
    """A simulated robot reported the status of its video."""

    node: str
    video: VideoStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class PageReported:
    """A simulated robot is shown on a page, or no longer is."""

    node: str
    url: str
    """With the token that opens the page; empty if the page has gone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownPublisherFound:
    """A node that is not part of the stack publishes on a topic that moves its robot."""

    topic: str
    node: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRequested:
    """The user, or the program that runs the launcher, requests a shutdown of the stack."""

    reason: str
    is_urgent: bool = False
    """Whether a repeated request forces a faster stop."""


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
    | PageReported
    | ChangeRequested
    | StatusRequested
    | UnknownPublisherFound
    | StopRequested
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionEnded:
    """A node's part of a transition has ended."""

    node: str
    transition: str
    result: Result
    seconds: float
    """Since the request [s]."""
    fault: str = ""
    """As the node reported it; otherwise empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """The whole stack reached a phase: `starting`, `ready`, `active`, `stopping`, ..."""

    name: str
    seconds: float
    """Since the launch [s]."""
    detail: str = ""
    """Why the stack stops, which nodes are rolled back, and the like; may be empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackStateChanged:
    """The state of the whole stack changed, for example to `inactive` or `activating`."""

    state: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Hung:
    """A node has not answered for `seconds`, although its process is running."""

    node: str
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswersAgain:
    """A node that hung is answering again."""

    node: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Restarting:
    """Nodes that crashed will be restarted after a wait [s]."""

    nodes: tuple[str, ...]
    wait_s: float
    attempt: int
    """Counts from 1 within the restart window."""
    attempts: int
    """Maximum number of restarts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Restarted:
    """Nodes that crashed are back in their previous state."""

    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GoesOnWithout:
    """Nodes are lost, and the stack continues without them, as its rules allow."""

    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateBroken:
    """An expected rate has been missed for 2 s, or is no longer reported."""

    node: str
    rate: Rate
    origin: str
    """Location of the period in the config, `file:line:column`; empty if it has none."""
    silent_s: float = 0.0
    """How long the node has not reported [s]; 0: it is reporting."""

    @property
    def how(self) -> str:
        """What is wrong, as a sentence."""
        rate = self.rate
        if self.silent_s:
            how = f"{rate.name} was not reported for {self.silent_s:.1f} s, "
            how += f"expected {hz(rate.expected_hz)} Hz"
        elif rate.late_p99_us:
            how = f"{rate} (p99 latency {rate.late_p99_us / 1e3:.3g} ms)"
        else:  # the simulator triggers its ticks, so they are never late
            how = str(rate)
        return f"{how}; set at {self.origin}" if self.origin else how


@dataclass(frozen=True, slots=True, kw_only=True)
class RatesUnreported:
    """An active node does not report its rates; C++ nodes never do.

    The launcher measures those that are visible on a topic.
    """

    node: str
    measured: tuple[str, ...]
    """Names of the rates that are measured on topics."""
    unknown: tuple[str, ...]
    """Names of the other rates."""

    @property
    def how(self) -> str:
        """Which rates are unknown, as a sentence."""
        unknown = f"; not measured: {', '.join(self.unknown)}" if self.unknown else ""
        measured = f"; measured on its topics: {', '.join(self.measured)}" if self.measured else ""
        return f"does not report its rates{measured}{unknown}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RateKept:
    """A broken rate is as expected again."""

    node: str
    rate: Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class RateMoved:
    """A rate that is off or broken has changed, or is no longer off."""

    node: str
    rate: Rate


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingFor:
    """The bring-up waits for nodes on other devices, which other launches start."""

    devices: tuple[str, ...]
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The last output lines of a stuck node's process, including its stack dump."""

    node: str
    """The node; if it shares its process with others, the name of the process."""
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalIgnored:
    """Processes are still running some time after a signal; the next one is sent now."""

    processes: tuple[str, ...]
    signal: str
    """Its name, such as `SIGINT`."""
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """The run has ended."""

    exit_code: int
    cause: str
    """The first cause of a failure; empty if the run succeeded."""
    consequences: int = 0
    """Number of failures after the first."""
    origin: str = ""
    """Location in the config, `file:line:column`, of the node that failed first."""


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
    | SignalIgnored
    | ActivationReported
    | VideoReported
    | PageReported
    | Ended
)


OUTPUT_EVENTS: Final[Mapping[str, type[OutputEvent]]] = {
    "StackState" if kind is StackStateChanged else kind.__name__: kind
    for kind in get_args(OutputEvent)
}
"""Name in `events.jsonl` and in the JSON stream -> event."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputLine:
    """A line of a process's output."""

    process: str
    """The name of its unit."""
    text: str


E = TypeVar("E")


class EventBus(Generic[E]):
    """Passes each event to all subscribers, in the order of their subscriptions."""

    def __init__(self) -> None:
        self._subscribers: list[Callable[[E], None]] = []

    def subscribe(self, subscriber: Callable[[E], None]) -> None:
        """Call `subscriber` with each event, in the publishing thread. Call before publishing."""
        self._subscribers.append(subscriber)

    def publish(self, event: E) -> None:
        """Pass an event to all subscribers."""
        for subscriber in self._subscribers:
            subscriber(event)


class EventPublisher:
    """Publishes the output events of one run, and the resulting changes of the stack's state."""

    def __init__(
        self,
        state: "StackState",
        clock: Callable[[], float],
        publish: Callable[[OutputEvent], None],
    ) -> None:
        """Start the run's clock.

        Args:
            state: the state of the stack.
            clock: monotonic time [s].
            publish: receives the events.
        """
        self._state = state
        self._clock = clock
        self._publish = publish
        self._begin = clock()
        self._phase = ""
        self._published_state = ""

    def publish(self, event: OutputEvent) -> None:
        """Publish an event, then the stack's state if the event changed it."""
        self._publish(event)
        self.publish_state()

    def publish_state(self) -> None:
        """Publish the stack's state if it has changed."""
        state = self._state.summary()
        if state != self._published_state:
            self._published_state = state
            self._publish(StackStateChanged(state=state))

    def phase(self, name: str, detail: str = "") -> None:
        """Publish that the stack reached a phase."""
        self._phase = name
        self.episode(name, detail)

    def episode(self, name: str, detail: str = "") -> None:
        """Publish an episode, after which the stack is in the same phase as before."""
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
    """`SIGINT`; most real-time signals have no name of their own."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
