"""A running stack of this host, second by second.

In: a run's folder, a participant in its ROS domain. Out: a `StackView` each time it is asked for
one. Nodes and states come from the launcher, loads from the kernel, rates and ages of messages from
subscriptions that deserialize nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from obk_cli.introspect.graph_source import LauncherParameters
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.monitor.expected_topics import (
    REALTIME_FACTOR,
    Speeds,
    planned_topics,
    simulated_robots,
)
from obk_cli.monitor.model import NodeView, StackView
from obk_cli.monitor.topic_watch import WINDOW_S, TopicWatch
from obk_cli.process.load import OwnCost, ProcessLoad, ProcessLoads
from obk_cli.ros.parameters import NodeParameter
from obk_cli.ros.participant import RosLook
from obk_cli.runs.control_client import ask_status
from obk_cli.runs.folder import Run, read_run, run_plan
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.logs import LAUNCH_LOG, last_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus
from obk_cli.runs.registry import is_alive
from obk_cli.runs.stacks import section_of

__all__ = ["WINDOW_S", "Observer"]

LINES: Final = 200
ANSWER_S: Final = 0.2
"""For a robot's word on its speed: others are not kept waiting [s]."""


class Observer:
    """Looks at one stack; call `turn` again and again, and `view` when something is to be shown."""

    def __init__(self, folder: Path, run: Run, look: RosLook) -> None:
        """Listen to the topics of the run's plan.

        Args:
            folder: the run's.
            run: what it tells.
            look: a participant in its domain.
        """
        self._folder = folder
        self._run = run
        self._loads = ProcessLoads()
        self._plan = run_plan(folder)
        self._watch = TopicWatch(look)
        self._watch.want(planned_topics(self._plan))
        simulated = simulated_robots(self._plan)
        self._speeds = Speeds(simulated, self._ask_factor)
        for node in simulated:
            self._watch.want_realtime_factor(f"{node}/rtf")
        if simulated:
            self._watch.want_parameter_events(self._speeds.hear)
        self._cost = OwnCost()
        self._told = tuple(_untold(run))
        """What the launcher said last of its nodes."""

    def turn(self) -> None:
        """Count what has come; returns after 20 ms."""
        self._watch.turn()

    def turn_for(self, seconds: float) -> None:
        """Count what comes for so long."""
        self._watch.turn_for(seconds)

    def view(self) -> StackView:
        """The stack as it is now."""
        status = ask_status(self._folder)
        run = self._run if status else read_run(self._folder) or self._run
        if status is not None:
            self._follow_speeds(status)
        has_ended = status is None and not is_alive(run)
        nodes = () if has_ended else self._nodes(status)
        active = {node.node for node in nodes if node.state == ACTIVE}
        return StackView(
            run=self._folder.name,
            name=run.name,
            domain=run.domain,
            state=status.state if status else "",
            phase=status.phase if status else "",
            uptime_s=status.seconds if status else 0.0,
            realtime_factor=self._watch.realtime_factor,
            nodes=nodes,
            topics=self._watch.views(active),
            lines=last_lines(self._folder / LAUNCH_LOG, LINES),
            cost_percent=self._cost.percent(),
            has_ended=has_ended,
            cause=run.cause,
        )

    def _follow_speeds(self, status: StackStatus) -> None:
        """Want the rates that go with the speeds at which robots are simulated by now."""
        before = self._speeds.factors
        self._speeds.look(status.nodes)
        if self._speeds.factors != before:
            self._watch.want(planned_topics(self._plan, self._speeds.factors))

    def _ask_factor(self, node: str) -> NodeParameter:
        parameters = LauncherParameters(self._folder, node, ANSWER_S)
        return parameters.values([REALTIME_FACTOR])[REALTIME_FACTOR]

    def _nodes(self, status: StackStatus | None) -> tuple[NodeView, ...]:
        told = status.nodes if status else tuple(map(_in_doubt, self._told))
        self._told = told
        loads = self._loads.look({node.pid for node in told if node.pid is not None})
        return tuple(_node(node, told, loads) for node in told)


def _untold(run: Run) -> Iterator[NodeStatus]:
    """The nodes of a run whose launcher has not told of them."""
    for name in run.all_nodes:
        yield NodeStatus(
            node=name,
            section=section_of(name) or "",
            device="",
            state=UNKNOWN if name in run.nodes else "",
            process=name,
            pid=None,
            restarts=0,
            hangs=False,
        )


def _in_doubt(node: NodeStatus) -> NodeStatus:
    """A node of which the launcher tells nothing now: its process may go on as it was."""
    return replace(node, state=UNKNOWN if node.state else "", hangs=False, rates=())


def _node(
    node: NodeStatus, all_nodes: tuple[NodeStatus, ...], loads: Mapping[int, ProcessLoad]
) -> NodeView:
    shared = sum(other.process == node.process for other in all_nodes)
    return NodeView(
        node=node.node,
        section=node.section,
        state=node.state,
        pid=node.pid,
        shares_process=shared > 1,
        load=None if node.pid is None else loads.get(node.pid),
        restarts=node.restarts,
        hangs=node.hangs,
        promises=node.rates,
    )
