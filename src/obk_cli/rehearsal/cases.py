"""The cases of a rehearsal: each fault for each process, and what is promised for it. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from obk_cli.launch.units import Unit
from obk_cli.plan.plan import TIERS, OnCrash
from obk_cli.rehearsal.promise import FAULTS, Allowances, Fault, Promise, promise

__all__ = ["Case", "make_cases"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One thing that is done to a stack."""

    unit: Unit
    """The process that it is done to."""
    fault: Fault
    promise: Promise

    @property
    def leaves_stack_whole(self) -> bool:
        """Whether, all being well, the stack is afterwards as it was before."""
        if self.promise.reaction == "go on":
            return self.fault != "kill"
        return self.promise.reaction != "stop"


def make_cases(
    units: Iterable[Unit],
    *,
    faults: Collection[Fault] = FAULTS,
    on_crash: OnCrash = "stop",
    nodes: Collection[str] = (),
    allowances: Allowances | None = None,
) -> tuple[Case, ...]:
    """The cases, in bring-up order of the processes; those that share a launch stand together.

    Args:
        units: the stack's processes.
        faults: what is done.
        on_crash: the launch's rule.
        nodes: full names of those whose processes are meant; none: all.
        allowances: how long the launcher may take.
    """
    meant = [unit for unit in units if not nodes or not set(nodes).isdisjoint(unit.node_names)]
    meant.sort(key=lambda unit: min(TIERS.index(node.section) for node in unit.nodes))
    every = [
        Case(unit=unit, fault=fault, promise=promise(unit, fault, on_crash, allowances))
        for fault in FAULTS
        if fault in faults
        for unit in meant
    ]
    return tuple(sorted(every, key=lambda case: not case.leaves_stack_whole))
