"""The cases of a rehearsal, and what the rules of a stack require after each fault. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final, Literal

from obelisk_spec.components import TIERS
from obk_cli.launch.process_groups import Unit, rule_of
from obk_cli.plan.plan import OnCrash

__all__ = ["FAULTS", "Allowances", "Case", "Fault", "Reaction", "expectation_of", "make_cases"]


Fault = Literal["delay", "freeze", "kill"]
Reaction = Literal["stop", "restart", "go on", "nothing"]

FAULTS: Final[tuple[Fault, ...]] = ("delay", "freeze", "kill")
"""The mildest first, because it leaves most of a stack intact."""
_REACTIONS: Final[dict[OnCrash, Reaction]] = {
    "stop": "stop",
    "restart": "restart",
    "ignore": "go on",
}
_SUMMARIES: Final[dict[Reaction, str]] = {
    "stop": "stack down, exit 1",
    "restart": "restarted, all active",
    "go on": "other nodes keep running",
    "nothing": "no reaction",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowances:
    """Time limits for a launcher's reactions [s]."""

    end_detected_s: float = 0.1
    """Until the launcher reports that a process has ended."""
    hang_detected_s: float = 2.0
    """Until the launcher reports that a node hangs, or responds again."""
    down_s: float = 10.0
    """From the fault until the launcher has exited."""
    back_s: float = 10.0
    """From the fault until restarted nodes are back in their former state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expectation:
    """The required reaction and its time limits."""

    reaction: Reaction
    detected_s: float
    """Limit until the launcher reports the fault [s]; unused if no reaction is expected."""
    settled_s: float
    """Limit until the stack is in the state that its rule requires [s]."""

    @property
    def summary(self) -> str:
        """The expectation in a few words, for a table."""
        return _SUMMARIES[self.reaction]


def expectation_of(
    unit: Unit, fault: Fault, on_crash: OnCrash, allowances: Allowances | None = None
) -> Expectation:
    """The reaction that the rules require after a fault.

    Args:
        unit: the process into which the fault is injected.
        fault: the fault.
        on_crash: the launch's rule, for nodes that do not set one.
        allowances: time limits for the launcher.
    """
    times = allowances or Allowances()
    reaction = _REACTIONS[rule_of(unit.nodes, on_crash)]
    if fault == "delay" or (fault == "freeze" and not _is_watched(unit)):
        reaction = "nothing"
    return Expectation(
        reaction=reaction,
        detected_s=times.end_detected_s if fault == "kill" else times.hang_detected_s,
        settled_s=times.down_s if reaction == "stop" else times.back_s,
    )


def _is_watched(unit: Unit) -> bool:
    """Whether hangs are detected: only nodes with a lifecycle have a heartbeat."""
    return any(node.has_lifecycle for node in unit.nodes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A fault in a process of a stack."""

    unit: Unit
    """The process into which the fault is injected."""
    fault: Fault
    expectation: Expectation

    @property
    def leaves_stack_complete(self) -> bool:
        """Whether the stack is complete again afterwards, if the expectation is met."""
        if self.expectation.reaction == "go on":
            return self.fault != "kill"
        return self.expectation.reaction != "stop"


def make_cases(
    units: Iterable[Unit],
    *,
    faults: Collection[Fault] = FAULTS,
    on_crash: OnCrash = "stop",
    nodes: Collection[str] = (),
    allowances: Allowances | None = None,
) -> tuple[Case, ...]:
    """The cases, in bring-up order of the processes; cases that can share a launch are adjacent.

    Args:
        units: the stack's processes.
        faults: the faults to inject.
        on_crash: the launch's rule.
        nodes: full names of the nodes whose processes are tested; empty: all.
        allowances: time limits for the launcher.
    """
    chosen = [unit for unit in units if not nodes or not set(nodes).isdisjoint(unit.node_names)]
    chosen.sort(key=lambda unit: min(TIERS.index(node.section) for node in unit.nodes))
    cases = [
        Case(unit=unit, fault=fault, expectation=expectation_of(unit, fault, on_crash, allowances))
        for fault in FAULTS
        if fault in faults
        for unit in chosen
    ]
    return tuple(sorted(cases, key=lambda case: not case.leaves_stack_complete))
