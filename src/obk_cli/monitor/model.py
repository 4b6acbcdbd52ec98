"""A snapshot of a running stack as values, the same for a terminal, a page and a program."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from obelisk_spec.runtime_protocol import STEPS, TOLERANCE, Rate
from obk_cli.ros.meters import TopicRate

__all__ = ["MessageAge", "NodeView", "ProcessLoad", "StackView", "TopicView", "Views"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessLoad:
    """A process's use of this machine."""

    cpu_percent: float
    """Relative to one core."""
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
    """Lifecycle state; empty for nodes without one."""
    pid: int | None
    """None: not running, or on another device."""
    shares_process: bool
    """Whether other nodes run in its process; the load is then that of all of them."""
    load: ProcessLoad | None
    """None: not running, or on another host."""
    restarts: int
    hangs: bool
    rates: tuple[Rate, ...]
    """The rates of its timers and sensors as last reported."""
    page: str = ""
    """URL of the page that shows the simulation, with its token; empty without one."""

    @property
    def is_slow_simulation(self) -> bool:
        """Whether it is a simulator that cannot keep up."""
        return any(rate.name == STEPS and rate.standing != "kept" for rate in self.rates)


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageAge:
    """Age of a topic's messages when received, by the stamps in their headers."""

    p50_s: float
    p99_s: float
    is_carried: bool
    """Whether the stamps come from upstream messages; the age is then that of the chain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicView:
    """One topic."""

    topic: str
    msg_type: str | None
    publishers: int
    subscriptions: int
    """Without the measuring subscription."""
    expected_hz: float | None
    """Rate implied by the config, at the speed of the simulation; None if there is none."""
    rate: TopicRate | None
    """The measured rate; None if not subscribed."""
    age: MessageAge | None = None
    """In the time base of the stamps, wall or simulated; None without stamps or a known clock."""
    is_expected: bool = True
    """Whether the rate is expected now: its publisher is active and was measured long enough."""
    made_from: tuple[str, ...] = ()
    """Topics that its publishers subscribe to; empty if they measure the world."""

    @property
    def is_off(self) -> bool:
        """Whether it differs by more than 10 % from the expected rate, while that is expected."""
        if self.expected_hz is None or self.rate is None or not self.is_expected:
            return False
        measured = self.rate.rate_hz or 0.0
        return abs(measured - self.expected_hz) > TOLERANCE * self.expected_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class StackView:
    """One stack."""

    run: str
    """Name of the run's folder; empty for nodes in the ROS graph that were launched elsewhere."""
    name: str
    domain: int
    state: str
    """As `StackStatus.state`; empty if the launcher does not answer."""
    phase: str
    uptime_s: float
    realtime_factor: float | None
    """Simulation time over wall time; None if nothing is simulated, or not reported yet."""
    nodes: tuple[NodeView, ...]
    topics: tuple[TopicView, ...]
    lines: tuple[str, ...]
    """The last lines of the launcher's log, oldest first."""
    cost_percent: float
    """Processor use of the monitor itself, of one core [%]."""
    has_ended: bool = False
    """Whether its launcher or, elsewhere, its nodes have exited, so that nothing will change."""
    cause: str = ""
    """The first failure in a run that has ended; empty if there was none."""


class Views(Protocol):
    """A follower of a stack, as used by the terminal and the page."""

    def views(self) -> Iterator[StackView | None]:
        """Yield a view per period; None while no stack is running."""
        ...

    def stop(self) -> None:
        """Stop the views soon."""
        ...
