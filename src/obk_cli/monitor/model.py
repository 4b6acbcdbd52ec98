"""A running stack at one moment, as values: the same for a terminal, a page and a program."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from obelisk_spec.runtime_protocol import STEPS, TOLERANCE
from obelisk_spec.runtime_protocol import Rate as Promised
from obk_cli.ros.meters import TopicRate

__all__ = ["MessageAge", "NodeView", "ProcessLoad", "StackView", "TopicView", "Views"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessLoad:
    """What a process uses of this machine."""

    cpu_percent: float
    """Of one core."""
    memory_bytes: int
    """Resident."""
    uptime_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeView:
    """One node."""

    node: str
    """Full name."""
    section: str
    """`control`, `estimation`, `robot`, ..."""
    state: str
    """Life-cycle state; empty for nodes without one."""
    pid: int | None
    """None: not running, or on another device."""
    shares_process: bool
    """Whether other nodes run in its process, so that the load is that of all."""
    load: ProcessLoad | None
    """None: not running, or on another host."""
    restarts: int
    hangs: bool
    promises: tuple[Promised, ...]
    """The rates of its timers and sensors as it reported them last."""

    @property
    def is_slow_simulation(self) -> bool:
        """Whether it is a simulator that cannot keep up."""
        return any(rate.name == STEPS and rate.standing != "kept" for rate in self.promises)


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageAge:
    """Age of a topic's messages on arrival, by the stamps in their headers."""

    p50_s: float
    p99_s: float
    is_carried: bool
    """Whether the stamps are those of messages further up: then the age is that of the chain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicView:
    """One topic."""

    topic: str
    msg_type: str | None
    publishers: int
    subscriptions: int
    """Without the subscription that measures."""
    expected_hz: float | None
    """What the config promises, at the speed that the simulation reaches; None: nothing."""
    rate: TopicRate | None
    """As measured; None: not subscribed."""
    age: MessageAge | None = None
    """In the time of the stamps, wall or simulated; None: no stamps, or of another clock."""
    is_expected: bool = True
    """Whether the rate is due now: its publisher is active and was measured for a while."""
    made_from: tuple[str, ...] = ()
    """Topics that its publishers subscribe to; none where these measure the world."""

    @property
    def is_off(self) -> bool:
        """Whether it is more than a tenth off what is expected, while it is due."""
        if self.expected_hz is None or self.rate is None or not self.is_expected:
            return False
        measured = self.rate.rate_hz or 0.0
        return abs(measured - self.expected_hz) > TOLERANCE * self.expected_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class StackView:
    """One stack."""

    run: str
    """The name of the run's folder; empty: nodes in the ROS graph, launched elsewhere."""
    name: str
    domain: int
    state: str
    """As `StackStatus.state`; empty where the launcher does not answer."""
    phase: str
    uptime_s: float
    realtime_factor: float | None
    """Simulation time over wall time; None: nothing is simulated, or not reported yet."""
    nodes: tuple[NodeView, ...]
    topics: tuple[TopicView, ...]
    lines: tuple[str, ...]
    """The last ones of the launcher's log, oldest first."""
    cost_percent: float
    """Processor use of the monitor itself, of one core [%]."""
    has_ended: bool = False
    """Whether its launcher is gone, elsewhere its nodes: nothing will change any more."""
    cause: str = ""
    """What went wrong first in a run that has ended; empty where nothing did."""


class Views(Protocol):
    """What a follower of a stack offers to a terminal or a page."""

    def views(self) -> Iterator[StackView | None]:
        """A view each period, None while nothing runs."""
        ...

    def stop(self) -> None:
        """End the views soon."""
        ...
