"""Looks at a running stack of this host, second by second.

In: a run's folder, a participant in its ROS domain. Out: a `StackView` each time it is asked for
one. Nodes and states come from the launcher, loads from the kernel, rates and ages of messages from
subscriptions that deserialize nothing.
"""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from obk_cli.adapters.clock import monotonic_s
from obk_cli.adapters.control_client import ask_status
from obk_cli.adapters.follow import last_lines
from obk_cli.adapters.process_load import OwnCost, ProcessLoad, ProcessLoads
from obk_cli.adapters.ros_look import RosLook
from obk_cli.adapters.ros_meter import RosMeter
from obk_cli.adapters.ros_types import fields_of, find_type, short_type
from obk_cli.asking.run_logs import LAUNCH_LOG
from obk_cli.errors import CommandFailedError
from obk_cli.launch.asks import NodeStatus, StackStatus
from obk_cli.launch.runs import Run
from obk_cli.launch.transitions import ACTIVE
from obk_cli.looking.rates import Rate
from obk_cli.looking.stamps import HEADER
from obk_cli.monitoring.passages import PassageMeter
from obk_cli.monitoring.promised import PlannedTopic, planned_topics
from obk_cli.monitoring.view import NodeView, StackView, TopicView
from obk_cli.recording.made_from import run_plan

__all__ = ["WINDOW_S", "Observer"]

WINDOW_S: Final = 2.0
"""How far back rates go: a topic that is throttled is marked within this [s]."""
LINES: Final = 200
_RTF_TYPE: Final = "std_msgs/msg/Float64"
_RTF: Final = struct.Struct("<4xd")
"""CDR of a `Float64`, in the byte order of this and every usual machine."""


class Observer:
    """Looks at one stack; call `turn` again and again, and `view` when something is to be shown."""

    def __init__(self, folder: Path, run: Run, look: RosLook) -> None:
        """Listen to the topics of the run's plan that this process has the types of.

        Args:
            folder: the run's.
            run: what it tells.
            look: a participant in its domain.
        """
        self._folder = folder
        self._run = run
        self._look = look
        self._plan = run_plan(folder)
        self._topics = planned_topics(self._plan)
        self._meter = RosMeter(look, WINDOW_S)
        self._passages: dict[str, PassageMeter] = {}
        self._loads = ProcessLoads()
        self._cost = OwnCost()
        self._realtime_factor: float | None = None
        for topic in self._topics:
            self._listen(topic)
        for node in self._simulated():
            self._meter.add(f"{node}/rtf", _RTF_TYPE, find_type(_RTF_TYPE), self._take_rtf)

    def turn(self) -> None:
        """Count what has come; returns after 5 ms."""
        self._meter.turn()

    def turn_for(self, seconds: float) -> None:
        """Count what comes for so long."""
        end = monotonic_s() + seconds
        while monotonic_s() < end:
            self._meter.turn()

    def view(self) -> StackView:
        """The stack as it is now."""
        status = ask_status(self._folder)
        nodes = self._nodes(status)
        active = {node.node for node in nodes if node.state == ACTIVE}
        rates = self._meter.rates()
        return StackView(
            run=self._folder.name,
            name=self._run.name,
            domain=self._run.domain,
            state=status.state if status else "",
            phase=status.phase if status else "",
            uptime_s=status.seconds if status else 0.0,
            realtime_factor=self._realtime_factor,
            nodes=nodes,
            topics=tuple(self._topic(topic, rates, active) for topic in self._topics),
            lines=last_lines(self._folder / LAUNCH_LOG, LINES),
            cost_percent=self._cost.percent(),
        )

    def _listen(self, topic: PlannedTopic) -> None:
        if topic.msg_type is None:
            return
        try:
            python_type = find_type(topic.msg_type)
            first = next(iter(fields_of(short_type(topic.msg_type)).values()), "")
        except CommandFailedError:
            return
        passage = PassageMeter() if first == HEADER else None
        if passage is not None:
            self._passages[topic.name] = passage
        watch = passage.take if passage is not None else None
        self._meter.add(topic.name, topic.msg_type, python_type, watch)

    def _simulated(self) -> tuple[str, ...]:
        """Full names of the nodes that simulate a robot."""
        processes = self._plan.get("processes", ())
        return tuple(
            f"{one['namespace'].rstrip('/')}/{one['node']}" for one in processes if one.get("model")
        )

    def _take_rtf(self, _received_ns: int, data: bytes) -> None:
        (self._realtime_factor,) = _RTF.unpack(data)

    def _nodes(self, status: StackStatus | None) -> tuple[NodeView, ...]:
        told = status.nodes if status else ()
        loads = self._loads.look({node.pid for node in told if node.pid is not None})
        return tuple(_node(node, told, loads) for node in told)

    def _topic(self, topic: PlannedTopic, rates: Mapping[str, Rate], active: set[str]) -> TopicView:
        seen = self._look.topic(topic.name)
        own = self._look.name
        passage = self._passages.get(topic.name)
        further_up = [self._passages[up] for up in topic.made_from if up in self._passages]
        return TopicView(
            topic=topic.name,
            msg_type=topic.msg_type,
            publishers=len(seen.publishers),
            subscriptions=sum(end.node != own for end in seen.subscriptions),
            wanted_hz=topic.wanted_hz,
            rate=rates.get(topic.name),
            passage=passage.passage(further_up) if passage else None,
            is_expected=bool(topic.publishers) and active.issuperset(topic.publishers),
        )


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
