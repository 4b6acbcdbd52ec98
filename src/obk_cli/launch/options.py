"""The options of a launch: which part of a plan, how far, how long, what follows from failures."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from obk_cli.launch.interfaces import Limits
from obk_cli.launch.process_groups import Share
from obk_cli.launch.transitions import Until
from obk_cli.plan.plan import OnCrash
from obk_cli.record.topic_filter import RecordRequest

__all__ = ["KEPT_RUNS", "LaunchOptions"]

KEPT_RUNS: Final = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchOptions:
    """The decisions of the user who launches a stack."""

    config: str
    """The config's path, shown to other terminals."""
    folder: Path
    """The working folder of the nodes."""
    share: Share
    """The part of the stack that runs here."""
    until: Until = "active"
    duration_s: float | None = None
    """How long the stack stays up [s]; None: until a stop is requested."""
    limits: Limits = field(default_factory=Limits)
    on_crash: OnCrash = "stop"
    """For nodes whose config sets none."""
    is_composed: bool = False
    """Whether the nodes that can share one process do."""
    strict_rates: bool = False
    """Whether the stack comes down for an expected rate that is broken."""
    replaces: bool = False
    """Whether conflicting launches are ended."""
    allows_foreign: bool = False
    """Whether nodes outside the stack may publish on the topics that move the robot."""
    recording: RecordRequest | None = None
    """What is recorded; without topics and patterns those of the plan. None: nothing."""
    kept_runs: int = KEPT_RUNS
    gated_executables: frozenset[tuple[str, str]] = frozenset()
    """Package and executable of programs whose node `spin_obelisk` makes, as far as is known."""
