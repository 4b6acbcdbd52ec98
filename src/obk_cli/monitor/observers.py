"""Observe a running stack: a local one through its launcher, any other one over ROS."""

import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import psutil

from obelisk_spec.runtime_protocol import CLOCK_TOPIC, USE_SIM_TIME
from obelisk_spec.sim_block import REALTIME_FACTOR
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.graph_source import LauncherParameters
from obk_cli.launch.transitions import UNKNOWN
from obk_cli.monitor.expected_topics import (
    PlannedTopic,
    RealtimeFactors,
    planned_topics,
    simulated_robots,
)
from obk_cli.monitor.model import NodeView, ProcessLoad, StackView
from obk_cli.monitor.topic_watch import RTF_TYPE, TopicWatch
from obk_cli.ros.graph import GET_STATE
from obk_cli.ros.parameters import NodeParameter
from obk_cli.ros.participant import OBSERVER_NODE, RosParticipant
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import find_type
from obk_cli.runs.folder import Run, plan_of_run, read_run
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.logs import LAUNCH_LOG, last_lines
from obk_cli.runs.protocol import NodeStatus, StackStatus, ask_status
from obk_cli.runs.registry import in_tier_order, is_alive, section_of

__all__ = ["LocalObserver", "OwnCpuUse", "ProcessLoads", "RemoteObserver"]

LINES: Final = 200
ANSWER_S: Final = 0.2
"""Limit for a robot's reply; a longer one would delay the other nodes [s]."""


class LocalObserver:
    """Observes one stack on this host: call `turn` repeatedly, and `view` to read the result."""

    def __init__(self, folder: Path, run: Run, participant: RosParticipant) -> None:
        """Subscribe to the topics of the run's plan.

        Args:
            folder: the folder of the run.
            run: the description of the run.
            participant: a participant in its domain.
        """
        self._folder = folder
        self._run = run
        self._loads = ProcessLoads()
        self._plan = plan_of_run(folder)
        self._watch = TopicWatch(participant)
        self._watch.set_topics(planned_topics(self._plan))
        self._simulated = simulated = simulated_robots(self._plan)
        self._factors = RealtimeFactors(simulated, self._ask_factor)
        for node in simulated:
            self._watch.watch_realtime_factor(rtf_topic(node))
        if any(process.parameters.get(USE_SIM_TIME) for process in self._plan.nodes):
            self._watch.watch_clock()
        if simulated:
            self._watch.watch_parameter_events(self._factors.take_event)
        self._cost = OwnCpuUse()
        self._last_nodes = tuple(_unreported(run))
        """The nodes as last reported by the launcher."""

    def turn(self) -> None:
        """Count received messages; returns after 20 ms."""
        self._watch.turn()

    def turn_for(self, seconds: float) -> None:
        """Count received messages for this time [s]."""
        self._watch.turn_for(seconds)

    def view(self) -> StackView:
        """The current state of the stack."""
        status = ask_status(self._folder)
        run = self._run if status else read_run(self._folder) or self._run
        if status is not None:
            self._update_expected_rates(status)
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

    def _update_expected_rates(self, status: StackStatus) -> None:
        """Update the expected rates from the real-time factors of simulated robots."""
        if not self._simulated:
            return
        self._factors.query_missing(status.nodes)
        measured = {
            node: factor
            for node in self._simulated
            if (factor := self._watch.measured_factor(rtf_topic(node))) is not None
        }
        self._watch.set_topics(planned_topics(self._plan, self._factors.factors, measured))

    def _ask_factor(self, node: str) -> NodeParameter:
        parameters = LauncherParameters(self._folder, node, ANSWER_S)
        return parameters.values([REALTIME_FACTOR])[REALTIME_FACTOR]

    def _nodes(self, status: StackStatus | None) -> tuple[NodeView, ...]:
        nodes_now = status.nodes if status else tuple(map(_with_unknown_state, self._last_nodes))
        self._last_nodes = nodes_now
        loads = self._loads.measure({node.pid for node in nodes_now if node.pid is not None})
        return tuple(_node(node, nodes_now, loads) for node in nodes_now)


def rtf_topic(robot: str) -> str:
    """The topic on which a simulated robot publishes its real-time factor."""
    return f"{robot}/rtf"


def _unreported(run: Run) -> Iterator[NodeStatus]:
    """The nodes of a run before its launcher has reported them."""
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


def _with_unknown_state(node: NodeStatus) -> NodeStatus:
    """A node that the launcher does not report; its process may still be running."""
    return replace(node, state=UNKNOWN if node.state else "", hangs=False, rates=(), page="")


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
        rates=node.rates,
        page=node.page,
    )


FIRST_ANSWER_S: Final = 1.0
"""Limit for a node's state while its service is being discovered [s]."""
REMOTE_ANSWER_S: Final = 0.2
"""Limit for a node's state afterwards, so that it does not delay other nodes [s]."""
OF_OBSERVERS: Final = f"/{OBSERVER_NODE}_"
OF_EVERY_NODE: Final = ("/rosout", "/parameter_events", "/diagnostics")


class RemoteObserver:
    """Observes all nodes of a ROS domain; same interface as `LocalObserver`."""

    def __init__(self, participant: RosParticipant) -> None:
        """Start without nodes.

        Args:
            participant: a participant in the domain.
        """
        self._participant = participant
        self._watch = TopicWatch(participant)
        self._clients: dict[str, ServiceClient] = {}
        self._states: dict[str, str] = {}
        self._watch_present_topics()
        self._cost = OwnCpuUse()

    def turn(self) -> None:
        """Count received messages; returns after 20 ms."""
        self._watch.turn()

    def turn_for(self, seconds: float) -> None:
        """Count received messages for this time [s]."""
        self._watch.turn_for(seconds)

    def view(self) -> StackView:
        """The current state of the domain."""
        self._watch_present_topics()
        names = in_tier_order(
            {name for name in self._participant.nodes() if not _is_observer(name)}
        )
        nodes = tuple(self._node(name) for name in names)
        active = {node.node for node in nodes if node.state == ACTIVE}
        return StackView(
            run="",
            name="",
            domain=self._participant.domain,
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

    def _watch_present_topics(self) -> None:
        topics = self._participant.topic_types()
        shown = {name: types for name, types in topics.items() if not _is_of_every_node(name)}
        if CLOCK_TOPIC in shown:
            self._watch.watch_clock()
        for name, types in shown.items():
            if name.endswith("/rtf") and types == (RTF_TYPE,):
                self._watch.watch_realtime_factor(name)
        self._watch.set_topics(
            PlannedTopic(
                name=name,
                msg_type=types[0] if len(types) == 1 else None,
                expected_hz=None,
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
            rates=(),
        )

    def _state(self, node: str) -> str:
        """The node's last reported state; empty without a lifecycle or a reply."""
        service = f"{node}/get_state"
        if GET_STATE not in self._participant.services_of(node).get(service, ()):
            return ""
        kind = find_type(GET_STATE)
        wait_s = REMOTE_ANSWER_S
        if node not in self._clients:
            self._clients[node] = ServiceClient(self._participant, service, kind)
            wait_s = FIRST_ANSWER_S
        with suppress(CommandFailedError):
            response = self._clients[node].call(kind.Request(), wait_s, is_question=True)
            self._states[node] = str(response.current_state.label)
        return self._states.get(node, "")


def _is_of_every_node(topic: str) -> bool:
    return topic in OF_EVERY_NODE or topic.endswith("/transition_event")


def _is_observer(node: str) -> bool:
    """Whether a node belongs to a command that observes, like this one."""
    return node.startswith(OF_OBSERVERS)


_PERCENT: Final = 100.0


class ProcessLoads:
    """Measures processes repeatedly, each time over the interval since the last measurement."""

    def __init__(self) -> None:
        self._known: dict[int, psutil.Process] = {}

    def measure(self, pids: Collection[int]) -> Mapping[int, ProcessLoad]:
        """Load by process; processes that have ended are omitted.

        The first measurement of a process covers the time since its start.
        """
        self._known = {pid: known for pid, known in self._known.items() if pid in pids}
        loads = {}
        for pid in pids:
            try:
                loads[pid] = self._load(pid)
            except psutil.Error:
                self._known.pop(pid, None)
        return loads

    def _load(self, pid: int) -> ProcessLoad:
        is_new = pid not in self._known
        process = self._known.setdefault(pid, psutil.Process(pid))
        with process.oneshot():
            uptime_s = max(time.time() - process.create_time(), 1e-3)
            measured = process.cpu_percent()
            times = process.cpu_times()
            since_start = _PERCENT * (times.user + times.system) / uptime_s
            return ProcessLoad(
                cpu_percent=since_start if is_new else measured,
                memory_bytes=process.memory_info().rss,
                uptime_s=uptime_s,
            )


class OwnCpuUse:
    """The processor time that this process uses."""

    def __init__(self) -> None:
        self._cpu_s, self._wall_s = time.process_time(), time.monotonic()

    def percent(self) -> float:
        """Use of one core since the last call [%]."""
        cpu_s, wall_s = time.process_time(), time.monotonic()
        used, passed = cpu_s - self._cpu_s, max(wall_s - self._wall_s, 1e-6)
        self._cpu_s, self._wall_s = cpu_s, wall_s
        return _PERCENT * used / passed
