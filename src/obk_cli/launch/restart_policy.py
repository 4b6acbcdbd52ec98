"""React to a crash: restart with back-off within a budget, continue without the node, or stop.

The policy is the `on_crash` in the node's config or, if unset, that of the launch.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from typing import Final, Literal

from obk_cli.launch.event_loop import RunContext
from obk_cli.launch.events import GoesOnWithout, Restarted, Restarting
from obk_cli.launch.processes import ProcessControl
from obk_cli.launch.stack_state import Crash
from obk_cli.launch.transition_runner import TransitionRunner
from obk_cli.launch.transitions import tiers_up, way_up
from obk_cli.runs.lifecycle import ACTIVE, UNCONFIGURED, Transition

__all__ = ["RestartPolicy"]

FIRST_BACKOFF_S: Final = 0.1


class _Budget:
    """Counts the restarts of a process, and limits how many are allowed within `window_s`."""

    def __init__(self, *, attempts: int, window_s: float) -> None:
        self._attempts = attempts
        self._window_s = window_s
        self._times: deque[float] = deque()
        self.count = 0
        """Number of restarts over the whole run."""

    @property
    def attempt(self) -> int:
        """The number of the latest restart within the window, counting from 1."""
        return len(self._times)

    def spend(self, now: float) -> float | None:
        """Use up one restart.

        Args:
            now: monotonic time [s].

        Returns:
            the back-off before the restart [s], which doubles with each restart in the window; None
            if the budget is spent.
        """
        while self._times and now - self._times[0] > self._window_s:
            self._times.popleft()
        if len(self._times) >= self._attempts:
            return None
        self._times.append(now)
        self.count += 1
        return float(FIRST_BACKOFF_S * 2 ** (len(self._times) - 1))


class RestartPolicy:
    """Collects crashes, and handles them when the supervisor calls it."""

    def __init__(
        self, context: RunContext, control: ProcessControl, runner: TransitionRunner
    ) -> None:
        self._context = context
        self._control = control
        self._runner = runner
        limits = context.limits
        self._budgets: defaultdict[str, _Budget] = defaultdict(
            lambda: _Budget(attempts=limits.restarts, window_s=limits.restart_window_s)
        )

    def crashed(self, node: str, kind: Literal["ended", "hung", "fault"], text: str) -> None:
        """Record a crash of a node or process; with `on_crash: stop`, the stack comes down."""
        state = self._context.state
        unit = state.unit_of.get(node, node)
        state.crashes.append(Crash(unit=unit, kind=kind, text=text, node=node))
        if state.on_crash(unit) == "stop":
            self._context.run.fail(text, node)

    def handle_crashes(self) -> None:
        """Handle all crashes: restore each node, go on without it, or end the run."""
        state, run = self._context.state, self._context.run
        while state.crashes and run.may_go_on:
            crash = state.crashes.popleft()
            if crash.unit not in state.units:
                continue  # on another device: the launch that started it restarts it
            if self._is_over(crash):
                continue
            if state.on_crash(crash.unit) == "ignore":
                self._go_on_without(crash)
            else:
                self._restart(crash)

    def _is_over(self, crash: Crash) -> bool:
        """Whether the node has recovered, or a later crash replaces this one."""
        state = self._context.state
        if crash.kind == "hung":
            return state.hung.isdisjoint(state.units[crash.unit].node_names)
        return crash.kind == "fault" and not self._runs(crash.unit)

    def _go_on_without(self, crash: Crash) -> None:
        state = self._context.state
        nodes = tuple(node.full_name for node in state.members(crash.unit))
        if crash.kind == "ended":
            state.lost.update(nodes)
        elif crash.kind == "fault":
            nodes = (crash.node,)
            state.failed.add(crash.node)
        self._context.publisher.publish(GoesOnWithout(nodes=nodes))

    def _restart(self, crash: Crash) -> None:
        """Restart once; a failure is recorded as another crash."""
        context, state = self._context, self._context.state
        is_fault = crash.kind == "fault"
        nodes = (crash.node,) if is_fault else state.units[crash.unit].node_names
        budget = self._budgets[crash.unit]
        wait_s = budget.spend(context.loop.now())
        if wait_s is None:
            often = f"{context.limits.restarts + 1} crashes within "
            often += f"{context.limits.restart_window_s:g} s"
            context.run.fail(f"{often}; the last one: {crash.text}", crash.node)
            return
        if crash.kind == "hung":
            self._control.report_evidence(min(state.hung.intersection(nodes)))
            self._control.kill(crash.unit)
        state.restarts[crash.unit] = budget.count
        for node in nodes:
            state.states[node] = UNCONFIGURED
        context.publisher.publish(
            Restarting(
                nodes=nodes,
                wait_s=wait_s,
                attempt=budget.attempt,
                attempts=context.limits.restarts,
            )
        )
        self._wait(context.loop.now() + wait_s)
        if not context.run.may_go_on:
            return
        if not is_fault and not self._start(crash.unit, nodes):
            return
        if self._restore(crash.unit, nodes):
            lifecycle_nodes = state.with_lifecycle.intersection(nodes)
            context.heartbeat.watch(lifecycle_nodes, context.loop.now())
            context.publisher.publish(Restarted(nodes=nodes))

    def _wait(self, until: float) -> None:
        while self._context.run.may_go_on and self._context.loop.wait(until):
            pass

    def _start(self, unit: str, nodes: Iterable[str]) -> bool:
        """Restart a process; wait until its nodes are ready, or until the process or the run ends.

        Returns:
            False if the old process did not end, or the nodes were not ready in time.
        """
        context, state = self._context, self._context.state
        if not self._wait_for_end(unit):
            return False
        state.forget_crashes(unit)
        self._control.start(unit)
        expected = state.with_lifecycle.intersection(nodes)
        until = context.loop.now() + context.limits.start_s
        while context.run.may_go_on and self._runs(unit) and not expected <= state.ready:
            if context.loop.wait(until) is None:
                late = sorted(expected - state.ready)
                text = f"no lifecycle services after a restart: {', '.join(late)}"
                self._give_up(late[0], text)
                return False
        return True

    def _wait_for_end(self, unit: str) -> bool:
        """Wait for a killed process to end; False if the stack begins to shut down first."""
        context = self._context
        until = context.loop.now() + context.limits.grace_s
        while context.run.may_go_on and self._runs(unit):
            if context.loop.wait(until) is None:
                context.run.fail(f"{unit}: the process is still running after SIGKILL")
        return context.run.may_go_on

    def _restore(self, unit: str, nodes: tuple[str, ...]) -> bool:
        """Take nodes to the state last requested for them, tier by tier as in the bring-up.

        Returns:
            whether all nodes are in that state; a failure counts as another crash.
        """
        state = self._context.state
        if not self._runs(unit):
            return False
        ways = {n: way_up(state.requested.get(n, UNCONFIGURED)) for n in nodes}
        for node in state.with_lifecycle.intersection(nodes):
            state.states[node] = UNCONFIGURED
        for transition in way_up(ACTIVE):
            for tier in tiers_up(state.plan):
                members = [node for node in tier if transition in ways.get(node, ())]
                if not self._reach(unit, transition, members):
                    return False
        return True

    def _reach(self, unit: str, transition: Transition, nodes: Sequence[str]) -> bool:
        context = self._context
        members = self._runner.request_all(transition, nodes, context.limits.transition_s)
        if not context.run.may_go_on:
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
        return unit in self._context.state.running

    def _give_up(self, node: str, text: str) -> None:
        """Record the failed attempt as a crash."""
        state = self._context.state
        unit = state.unit_of[node]
        self._control.kill(unit)
        state.crashes.append(Crash(unit=unit, kind="ended", text=text, node=node))
