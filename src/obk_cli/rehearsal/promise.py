"""What a stack's rules promise when something happens to one of its processes. Pure."""

from dataclasses import dataclass
from typing import Final, Literal

from obk_cli.launch.units import Unit, rule_of
from obk_cli.plan.plan import OnCrash

__all__ = ["FAULTS", "Allowances", "Fault", "Promise", "Reaction", "promise"]

Fault = Literal["delay", "freeze", "kill"]
Reaction = Literal["stop", "restart", "go on", "nothing"]

FAULTS: Final[tuple[Fault, ...]] = ("delay", "freeze", "kill")
"""The mildest first: what is left of a stack after it is the most."""
_REACTIONS: Final[dict[OnCrash, Reaction]] = {
    "stop": "stop",
    "restart": "restart",
    "ignore": "go on",
}
_WORDS: Final[dict[Reaction, str]] = {
    "stop": "stack down, exit 1",
    "restart": "restarted, all active",
    "go on": "the others run on",
    "nothing": "no reaction",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowances:
    """How long a launcher may take [s]."""

    end_noticed_s: float = 0.1
    """Until it tells that a process has ended."""
    hang_noticed_s: float = 2.0
    """Until it tells that a node hangs, or answers again."""
    down_s: float = 10.0
    """From the fault until the launcher has ended."""
    back_s: float = 10.0
    """From the fault until nodes that are started again are where they were."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What is to follow."""

    reaction: Reaction
    noticed_s: float
    """Within which the launcher is to tell of the fault [s]; of no meaning for no reaction."""
    settled_s: float
    """Within which the stack is to be where its rule leads [s]."""

    @property
    def words(self) -> str:
        """The promise for a table."""
        return _WORDS[self.reaction]


def promise(
    unit: Unit, fault: Fault, on_crash: OnCrash, allowances: Allowances | None = None
) -> Promise:
    """What the rules promise.

    Args:
        unit: the process that it happens to.
        fault: what happens.
        on_crash: the launch's rule, for nodes whose config does not say.
        allowances: the times in which it is to happen.
    """
    times = allowances or Allowances()
    reaction = _REACTIONS[rule_of(unit.nodes, on_crash)]
    if fault == "delay" or (fault == "freeze" and not _is_watched(unit)):
        reaction = "nothing"
    return Promise(
        reaction=reaction,
        noticed_s=times.end_noticed_s if fault == "kill" else times.hang_noticed_s,
        settled_s=times.down_s if reaction == "stop" else times.back_s,
    )


def _is_watched(unit: Unit) -> bool:
    """Whether a hang can be seen: only who has a life cycle is asked for signs of life."""
    return any(node.has_lifecycle for node in unit.nodes)
