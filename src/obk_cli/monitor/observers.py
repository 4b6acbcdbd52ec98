"""Observe a running stack: a local one through its launcher, any other one over ROS."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import LauncherParameters
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.monitor.expected_topics import (
    REALTIME_FACTOR,
    PlannedTopic,
    Speeds,
    planned_topics,
    simulated_robots,
)
from obk_cli.monitor.model import NodeView, StackView
from obk_cli.monitor.topic_watch import RTF_TYPE, TopicWatch
from obk_cli.process.load import OwnCost, ProcessLoad, ProcessLoads
from obk_cli.ros.parameters import NodeParameter
from obk_cli.ros.participant import LOOKER, RosLook
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import find_type
from obk_cli.runs.control_client import ask_status
from obk_cli.runs.folder import Run, read_run, run_plan
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.logs import LAUNCH_LOG, last_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus
from obk_cli.runs.registry import in_tier_order, is_alive, section_of

__all__ = ["ElsewhereObserver", "Observer"]

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


GET_STATE: Final = "lifecycle_msgs/srv/GetState"
FIRST_ANSWER_S: Final = 1.0
"""For a node's state, while its service is being found [s]."""
REMOTE_ANSWER_S: Final = 0.2
"""For a node's state later on: others are not kept waiting [s]."""
OF_LOOKERS: Final = f"/{LOOKER}_"
OF_EVERY_NODE: Final = ("/rosout", "/parameter_events", "/diagnostics")


class ElsewhereObserver:
    """Looks at all nodes of a ROS domain; used like an `Observer`."""

    def __init__(self, look: RosLook) -> None:
        """Begin to look.

        Args:
            look: a participant in the domain.
        """
        self._look = look
        self._watch = TopicWatch(look)
        self._clients: dict[str, ServiceClient] = {}
        self._states: dict[str, str] = {}
        self._want_what_is_there()
        self._cost = OwnCost()

    def turn(self) -> None:
        """Count what has come; returns after 20 ms."""
        self._watch.turn()

    def turn_for(self, seconds: float) -> None:
        """Count what comes for so long."""
        self._watch.turn_for(seconds)

    def view(self) -> StackView:
        """The domain as it is now."""
        self._want_what_is_there()
        names = in_tier_order({name for name in self._look.nodes() if not _is_looking(name)})
        nodes = tuple(self._node(name) for name in names)
        active = {node.node for node in nodes if node.state == ACTIVE}
        return StackView(
            run="",
            name="",
            domain=self._look.domain,
            state="",
            phase="",
            uptime_s=0.0,
            realtime_factor=self._watch.realtime_factor,
            nodes=nodes,
            topics=self._watch.views(active),
            lines=(),
            cost_percent=self._cost.percent(),
            has_ended=not nodes,
        )

    def _want_what_is_there(self) -> None:
        topics = self._look.topic_types()
        shown = {name: types for name, types in topics.items() if not _is_of_every_node(name)}
        for name, types in shown.items():
            if name.endswith("/rtf") and types == (RTF_TYPE,):
                self._watch.want_realtime_factor(name)
        self._watch.want(
            PlannedTopic(
                name=name,
                msg_type=types[0] if len(types) == 1 else None,
                wanted_hz=None,
                publishers=(),
                made_from=(),
            )
            for name, types in shown.items()
        )

    def _node(self, name: str) -> NodeView:
        return NodeView(
            node=name,
            section=section_of(name) or "",
            state=self._state(name),
            pid=None,
            shares_process=False,
            load=None,
            restarts=0,
            hangs=False,
            promises=(),
        )

    def _state(self, node: str) -> str:
        """What it answered last; empty where it has none, or never answered."""
        service = f"{node}/get_state"
        if GET_STATE not in self._look.services_of(node).get(service, ()):
            return ""
        kind = find_type(GET_STATE)
        wait_s = REMOTE_ANSWER_S
        if node not in self._clients:
            self._clients[node] = ServiceClient(self._look, service, kind)
            wait_s = FIRST_ANSWER_S
        with suppress(CommandFailedError):
            response = self._clients[node].call(kind.Request(), wait_s, is_question=True)
            self._states[node] = str(response.current_state.label)
        return self._states.get(node, "")


def _is_of_every_node(topic: str) -> bool:
    return topic in OF_EVERY_NODE or topic.endswith("/transition_event")


def _is_looking(node: str) -> bool:
    """Whether it is one of those who look into the stack as this one does."""
    return node.startswith(OF_LOOKERS)
