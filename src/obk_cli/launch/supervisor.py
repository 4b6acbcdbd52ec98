"""Runs a plan: start, configure and activate in order, watch, bring down; nothing stays behind.

Hears from processes and nodes through one inbox, acts through two doors, tells what it does as
events. Knows no ROS, no operating system and no terminal; the clock is handed in.
"""

from collections.abc import Callable, Collection, Iterable
from typing import Final

from obk_cli.launch.change import Change, learn_states, make_change, reason
from obk_cli.launch.descent import bring_down
from obk_cli.launch.doors import Inbox, Lifecycle, Limits, Processes
from obk_cli.launch.events import Ended, Told, WaitingFor
from obk_cli.launch.hearing import Hearing
from obk_cli.launch.order import UNTIL, Until
from obk_cli.launch.recovery import Recovery
from obk_cli.launch.roster import Roster
from obk_cli.launch.transitions import Transition, way_up
from obk_cli.launch.units import Unit
from obk_cli.launch.vigil import keep_vigil
from obk_cli.plan.plan import OnCrash, Plan

__all__ = ["Supervisor"]

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
REMINDER_S: Final = 5.0
"""Between two words on what is waited for [s]."""
REACHED: Final[dict[Until, str]] = {
    "none": "started",
    "configured": "configured",
    "active": "active",
}


class Supervisor:
    """One run of one plan, or of this machine's part of it."""

    def __init__(
        self,
        plan: Plan,
        *,
        units: Iterable[Unit],
        processes: Processes,
        lifecycle: Lifecycle,
        inbox: Inbox,
        clock: Callable[[], float],
        tell: Callable[[Told], None],
        limits: Limits | None = None,
        on_crash: OnCrash = "stop",
        lead: str | None = None,
        strict_rates: bool = False,
    ) -> None:
        """Make a supervisor; `run` does everything.

        Args:
            plan: the whole stack.
            units: the processes that run here; nodes that are in none run on other devices.
            processes: starts and signals processes.
            lifecycle: asks nodes for transitions.
            inbox: where both doors, signals and those who ask put what they have.
            clock: monotonic time [s].
            tell: takes what happens.
            limits: deadlines.
            on_crash: for nodes whose config does not say.
            lead: full name of the state node of the launch that takes the nodes through their
                transitions; None: this one does, those of other devices too.
            strict_rates: whether the stack comes down for a promised rate that is broken.
        """
        self._roster = Roster(plan, units, leads=lead is None, on_crash=on_crash)
        self._hearing = Hearing(
            self._roster,
            processes=processes,
            lifecycle=lifecycle,
            inbox=inbox,
            clock=clock,
            tell=tell,
            limits=limits or Limits(),
            strict_rates=strict_rates,
        )
        self._hearing.lead = lead
        self._recovery = Recovery(self._hearing)

    def run(self, until: Until = "active", duration_s: float | None = None) -> Ended:
        """Bring the stack up, watch it, bring it down.

        Args:
            until: how far the bring-up goes.
            duration_s: how long the stack runs after the bring-up [s]; None: until asked to stop.
        """
        hearing = self._hearing
        hearing.busy_with = "on its way up"
        if self._bring_up(until):
            end = None if duration_s is None else hearing.clock() + duration_s
            keep_vigil(hearing, self._recovery, end)
            if hearing.may_go_on:
                hearing.stop = f"{duration_s:g} s are over"
        bring_down(hearing)
        ended = self._ended()
        hearing.story.tell(ended)
        return ended

    def _ended(self) -> Ended:
        failures = self._hearing.failures
        if not failures:
            return Ended(exit_code=EXIT_DONE, cause="")
        node = self._roster.nodes.get(failures[0].node or "")
        return Ended(
            exit_code=EXIT_FAILED,
            cause=failures[0].text,
            consequences=len(failures) - 1,
            origin=str(node.origin) if node else "",
        )

    def _bring_up(self, until: Until) -> bool:
        hearing, roster = self._hearing, self._roster
        count = len(roster.units)
        hearing.story.phase("starting", f"{count} process{'es' if count > 1 else ''}")
        for unit in roster.units:
            hearing.start(unit)
        if not self._wait_for_own() or not self._wait_for_others():
            return False
        hearing.story.phase("ready")
        if hearing.lead is not None:
            hearing.lifecycle.watch(roster.elsewhere())
            hearing.story.phase("following", hearing.lead)
            return True
        if not all(self._make(transition) for transition in way_up(UNTIL[until])):
            return False
        hearing.story.phase(REACHED[until])
        return True

    def _wait_for_own(self) -> bool:
        """Until every node of this machine is there, or lost."""
        hearing, roster = self._hearing, self._roster
        deadline = hearing.clock() + hearing.limits.start_s
        while hearing.may_go_on and (late := self._missing(roster.here())):
            if hearing.crashes:
                self._recovery.deal_with_crashes()
            elif hearing.hear(deadline) is None:
                names = ", ".join(sorted(late))
                limit_s = hearing.limits.start_s
                for node in sorted(late):
                    hearing.give_evidence(node)
                hearing.fail(f"no life-cycle services after {limit_s:g} s: {names}", min(late))
        return hearing.may_go_on

    def _wait_for_others(self) -> bool:
        """Until every node of other devices is there; they are started by hand, so for ever."""
        hearing, roster = self._hearing, self._roster
        others = roster.with_lifecycle - roster.here()
        hearing.lifecycle.watch(others)
        reminder = hearing.clock()
        while hearing.may_go_on and (late := self._missing(others)):
            if hearing.crashes:
                self._recovery.deal_with_crashes()
            elif hearing.hear(reminder) is None:
                devices = dict.fromkeys(roster.nodes[node].device for node in sorted(late))
                hearing.story.tell(WaitingFor(devices=tuple(devices), nodes=tuple(sorted(late))))
                reminder = hearing.clock() + REMINDER_S
        silent = learn_states(hearing, others) if hearing.may_go_on else frozenset()
        for node in sorted(silent):
            hearing.fail(f"{node}: does not tell its state", node)
        return hearing.may_go_on

    def _missing(self, nodes: Collection[str]) -> frozenset[str]:
        return frozenset(nodes) - self._roster.ready - self._roster.lost

    def _make(self, transition: Transition) -> bool:
        """Take every node through a transition; nodes that crash are brought back on the way."""
        hearing = self._hearing
        limit_s = hearing.limits.transition_s
        while hearing.may_go_on:
            nodes = frozenset(self._roster.counted())
            answer = make_change(
                hearing, Change(transition=transition, nodes=nodes, limit_s=limit_s)
            )
            if answer.success:
                # One that got there may have died since.
                self._recovery.deal_with_crashes()
                return hearing.may_go_on
            culprits = [m for m in answer.members if m.is_culprit and m.result != "gone"]
            for member in culprits:
                hearing.fail(reason(member, transition, limit_s), member.node)
            if not culprits and not hearing.crashes and hearing.may_go_on:
                hearing.fail(answer.why)
            self._recovery.deal_with_crashes()
        return False
