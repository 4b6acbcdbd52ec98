"""The interfaces of the supervisor, as types: its inbox, the processes, the nodes, its limits."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from obk_cli.launch.events import InputEvent
from obk_cli.launch.process_groups import Unit

__all__ = ["Inbox", "Lifecycle", "Limits", "Processes"]


class Inbox(Protocol):
    """The input events in order; a `queue.SimpleQueue` is one."""

    def get(self, *, timeout: float | None) -> InputEvent:
        """The next event; raises `queue.Empty` after `timeout` [s]."""


class Processes(Protocol):
    """The interface to the operating system."""

    def start(self, unit: Unit) -> None:
        """Start a process; `ProcessStarted` or `ProcessEnded` follows."""

    def signal(self, process: str, number: int) -> None:
        """Send a signal to a process and all of its children."""

    def dump_stack(self, process: str) -> None:
        """Have a process that can write the stacks of its threads to its output."""

    def last_lines(self, process: str) -> tuple[str, ...]:
        """The last lines of a process's output."""


class Lifecycle(Protocol):
    """The interface to the nodes."""

    def watch(self, nodes: Iterable[str]) -> None:
        """Watch these nodes, again for restarted ones; `Ready` follows."""

    def request(self, node: str, transition: str) -> None:
        """Request a transition of a node; `Answered` follows."""

    def ask_state(self, node: str) -> None:
        """Ask a node for its state; `StateAnswered` follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How long things may take [s]."""

    transition_s: float = 10.0
    start_s: float = 20.0
    grace_s: float = 3.0
    """Between two signals, each harder than the one before."""
    down_s: float = 3.0
    """For one transition on the way down."""
    answer_s: float = 2.0
    """For the answer to a question."""
    hurry_s: float = 0.5
    """Instead of `grace_s` after the second request to stop."""
    hang_s: float = 1.3
    """A node that has not answered for this long hangs; `inf`: never."""
    dump_s: float = 0.3
    """For writing a stack dump."""
    restarts: int = 5
    """Allowed within `restart_window_s`; one more crash stops the stack."""
    restart_window_s: float = 30.0
