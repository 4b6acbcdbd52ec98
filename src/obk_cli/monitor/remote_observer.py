"""A stack that was launched on another host, or by other means, as the ROS graph tells of it.

In: a participant in its ROS domain. Out: a `StackView` without processes, log and wanted rates:
these only its launcher's host knows.
"""

from contextlib import suppress
from typing import Final

from obk_cli.errors import CommandFailedError
from obk_cli.monitor.expected_topics import PlannedTopic
from obk_cli.monitor.model import NodeView, StackView
from obk_cli.monitor.topic_watch import RTF_TYPE, TopicWatch
from obk_cli.process.load import OwnCost
from obk_cli.ros.participant import LOOKER, RosLook
from obk_cli.ros.services import ServiceClient
from obk_cli.ros.types import find_type
from obk_cli.runs.lifecycle import ACTIVE
from obk_cli.runs.stacks import in_tier_order, section_of

__all__ = ["ElsewhereObserver"]

GET_STATE: Final = "lifecycle_msgs/srv/GetState"
FIRST_ANSWER_S: Final = 1.0
"""For a node's state, while its service is being found [s]."""
ANSWER_S: Final = 0.2
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
        wait_s = ANSWER_S
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
