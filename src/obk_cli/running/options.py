"""How a plan is run: what of it, how far, how long, and what happens when something fails."""

from dataclasses import dataclass, field
from pathlib import Path

from obk_cli.adapters.claims import KEPT_RUNS
from obk_cli.launch.devices import Share
from obk_cli.launch.doors import Limits
from obk_cli.launch.order import Until
from obk_cli.plan.plan import OnCrash
from obk_cli.recording.choice import Wish

__all__ = ["LaunchOptions"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """What whoever launches a stack decides."""

    config: str
    """The config's path, for other terminals."""
    folder: Path
    """Where the nodes work."""
    share: Share
    """What of the stack runs here."""
    until: Until = "active"
    duration_s: float | None = None
    """How long the stack stays up [s]; None: until it is asked to stop."""
    limits: Limits = field(default_factory=Limits)
    on_crash: OnCrash = "stop"
    """For nodes whose config does not say."""
    is_composed: bool = False
    """Whether the nodes that can share one process do."""
    strict_rates: bool = False
    """Whether the stack comes down for a promised rate that is broken."""
    replaces: bool = False
    """Whether a launch that is in the way is ended."""
    allows_foreign: bool = False
    """Whether others may publish on the topics that move the robot."""
    recording: Wish | None = None
    """What is recorded; without topics and patterns those of the plan. None: nothing."""
    kept_runs: int = KEPT_RUNS
    spun: frozenset[tuple[str, str]] = frozenset()
    """Package and executable of programs of which is known that `spin_obelisk` makes their node."""
