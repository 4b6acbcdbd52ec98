"""Brings what crashed back to where it was, as often as its budget allows; or goes on without."""

from collections import defaultdict
from collections.abc import Iterable, Sequence

from obk_cli.launch.change import ask_all
from obk_cli.launch.events import GoesOnWithout, Restarted, Restarting
from obk_cli.launch.failures import Crash
from obk_cli.launch.hearing import Hearing
from obk_cli.launch.order import tiers_up
from obk_cli.launch.restarts import Budget
from obk_cli.launch.transitions import way_up
from obk_cli.runs.lifecycle import ACTIVE, UNCONFIGURED, Transition

__all__ = ["Recovery"]


class Recovery:
    """Deals with the crashes that have been heard of."""

    def __init__(self, hearing: Hearing) -> None:
        """Begin with every budget whole."""
        self._hearing = hearing
        self._budgets: defaultdict[str, Budget] = defaultdict(
            lambda: Budget(
                attempts=hearing.limits.restarts, window_s=hearing.limits.restart_window_s
            )
        )

    def deal_with_crashes(self) -> None:
        """Deal with all of them; afterwards nodes are back, or lost, or the stack comes down."""
        hearing = self._hearing
        while hearing.crashes and hearing.may_go_on:
            crash = hearing.crashes.popleft()
            if crash.unit not in hearing.roster.units:
                continue  # Of another device: whoever started it brings it back.
            if self._is_over(crash):
                continue
            if crash.kind == "hung":
                # Nodes of one process hang together.
                hearing.forget_crashes(crash.unit, hangs_only=True)
            if hearing.roster.on_crash(crash.unit) == "ignore":
                self._goes_on_without(crash)
            else:
                self._restart(crash)

    def _is_over(self, crash: Crash) -> bool:
        """Whether it has passed by itself, or a crash that comes after it counts instead."""
        roster = self._hearing.roster
        if crash.kind == "hung":
            return roster.hung.isdisjoint(roster.units[crash.unit].node_names)
        return crash.kind == "fault" and not self._runs(crash.unit)

    def _goes_on_without(self, crash: Crash) -> None:
        roster = self._hearing.roster
        nodes = tuple(node.full_name for node in roster.members(crash.unit))
        if crash.kind == "ended":
            roster.lost.update(nodes)
        elif crash.kind == "fault":
            nodes = (crash.node,)
            roster.failed.add(crash.node)
        self._hearing.story.tell(GoesOnWithout(nodes=nodes))

    def _restart(self, crash: Crash) -> None:
        """Once; where that fails, another crash waits to be dealt with."""
        hearing = self._hearing
        roster = hearing.roster
        is_fault = crash.kind == "fault"
        nodes = (crash.node,) if is_fault else roster.units[crash.unit].node_names
        wait_s = self._budgets[crash.unit].spend(hearing.clock())
        if wait_s is None:
            often = f"{hearing.limits.restarts + 1} crashes within "
            often += f"{hearing.limits.restart_window_s:g} s"
            hearing.fail(f"{often}; the last one: {crash.text}", crash.node)
            return
        if crash.kind == "hung":
            hearing.give_evidence(min(roster.hung.intersection(nodes)))
            hearing.kill(crash.unit)
        budget = self._budgets[crash.unit]
        roster.restarts[crash.unit] = budget.count
        for node in nodes:
            roster.states[node] = UNCONFIGURED
        hearing.story.tell(
            Restarting(
                nodes=nodes,
                wait_s=wait_s,
                attempt=budget.attempt,
                attempts=hearing.limits.restarts,
            )
        )
        self._wait(hearing.clock() + wait_s)
        if not hearing.may_go_on:
            return
        if not is_fault and not self._start(crash.unit, nodes):
            return
        if self._is_up_again(crash.unit, nodes):
            hearing.watch(set(nodes) & roster.with_lifecycle)
            hearing.story.tell(Restarted(nodes=nodes))

    def _wait(self, until: float) -> None:
        while self._hearing.may_go_on and self._hearing.hear(until):
            pass

    def _start(self, unit: str, nodes: Iterable[str]) -> bool:
        """Start a process again and wait until its nodes are there, or gone; False: no use."""
        hearing = self._hearing
        if not self._has_ended(unit):
            return False
        hearing.forget_crashes(unit)
        hearing.start(unit)
        expected = set(nodes) & hearing.roster.with_lifecycle
        until = hearing.clock() + hearing.limits.start_s
        while hearing.may_go_on and self._runs(unit) and not expected <= hearing.roster.ready:
            if hearing.hear(until) is None:
                late = ", ".join(sorted(expected - hearing.roster.ready))
                self._give_up(
                    min(expected - hearing.roster.ready),
                    f"no life-cycle services after a restart: {late}",
                )
                return False
        return True

    def _has_ended(self, unit: str) -> bool:
        """Wait for the end of a process that was killed; False: the stack comes down first."""
        hearing = self._hearing
        until = hearing.clock() + hearing.limits.grace_s
        while hearing.may_go_on and self._runs(unit):
            if hearing.hear(until) is None:
                hearing.fail(f"{unit}: the process is still there after SIGKILL")
        return hearing.may_go_on

    def _is_up_again(self, unit: str, nodes: tuple[str, ...]) -> bool:
        """Take nodes to where they were, tier by tier as at the bring-up.

        False: it did not work, and that is a crash of its own.
        """
        hearing = self._hearing
        roster = hearing.roster
        if not self._runs(unit):
            return False
        ways = {n: way_up(roster.wanted.get(n, UNCONFIGURED)) for n in nodes}
        for node in set(nodes) & roster.with_lifecycle:
            roster.states[node] = UNCONFIGURED
        for transition in way_up(ACTIVE):
            for tier in tiers_up(roster.plan):
                asked = [node for node in tier if transition in ways.get(node, ())]
                if not self._is_made(unit, transition, asked):
                    return False
        return True

    def _is_made(self, unit: str, transition: Transition, nodes: Sequence[str]) -> bool:
        hearing = self._hearing
        members = ask_all(hearing, transition, nodes, hearing.limits.transition_s)
        if not hearing.may_go_on:
            return False
        failed = next((members[node] for node in nodes if members[node].result != "reached"), None)
        if failed is None:
            return True
        if self._runs(unit):
            first = f": {failed.fault.splitlines()[0]}" if failed.fault else ""
            what = f"the transition `{transition.name}` failed after a restart{first}"
            self._give_up(failed.node, f"{failed.node}: {what}")
        return False

    def _runs(self, unit: str) -> bool:
        return unit in self._hearing.roster.running

    def _give_up(self, node: str, text: str) -> None:
        """This attempt is over."""
        unit = self._hearing.roster.unit_of[node]
        self._hearing.kill(unit)
        self._hearing.crashes.append(Crash(unit=unit, kind="ended", text=text, node=node))
