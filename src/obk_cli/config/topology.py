"""The endpoints of all topics of a stack: who publishes and who subscribes.

They include those of the simulator's sensor groups and of the joystick. Names are made absolute as
in ROS.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from obelisk_spec.names import resolve_msg_type
from obelisk_spec.sensors import sensor_group
from obk_cli.config.model import (
    FEEDBACK_TOPIC,
    JOYSTICK_TOPIC,
    Component,
    ExternalTopic,
    Joystick,
    Node,
    Qos,
    Remapping,
    SensorGroup,
    Spanned,
    Stack,
)
from obk_cli.diagnostics.diagnostic import Related
from obk_cli.diagnostics.source import Span

__all__ = [
    "OUTSIDE",
    "Direction",
    "TopicEndpoint",
    "Topology",
    "absolute_topic",
    "joystick_endpoints",
    "may_be_one",
    "node_endpoints",
    "publisher_of_timer",
    "sending_period_s",
    "stack_endpoints",
    "timers_of",
]

Direction = Literal["publishes", "subscribes"]

OUTSIDE = "outside the stack"
"""Owner of the endpoints of external topics."""
_TYPE_OF_STANDARD = {"pub_true_sim_state": "obelisk_sensor_msgs/msg/TrueSimState"}
_ONE_SEED_NAME = {
    "obelisk_sensor_msgs/msg/JointEncoders",
    "obelisk_sensor_msgs/msg/ObkJointEncoders",
}
"""Configs for the original Obelisk may use the first name even though the C++ code, which
determines the type at run time, uses the second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicEndpoint:
    """A publisher or subscriber of a topic."""

    direction: Direction
    topic: str
    """Absolute."""
    msg_type: str | None
    """Full name; None if only the code knows it."""
    owner: str
    """The node's full name."""
    section: str
    span: Span
    """The topic as written."""
    type_span: Span | None = None
    ignores_type: bool = False
    """Whether `msg_type` is informational only, because the node is in C++."""
    code_type: str | None = None
    """The type in the node's source, if that can be read; this type is used at run time."""
    qos: Qos = Qos()  # noqa: RUF009  (frozen)
    rate_hz: float | None = None
    component: str | None = None
    remapping: Remapping | None = None
    """The remapping that gave the topic its name; None if it keeps its name from the config."""
    is_optional: bool = False
    """Whether the topic is valid without another endpoint."""

    @property
    def renamed(self) -> tuple[Related, ...]:
        """The location of the remapping, for findings about the topic."""
        if self.remapping is None:
            return ()
        message = f"`{self.remapping.old}` is remapped to `{self.remapping.new}` here"
        return (Related(message=message, span=self.remapping.span),)

    @property
    def is_external(self) -> bool:
        """Whether a node outside the stack has this endpoint."""
        return self.owner == OUTSIDE

    @property
    def who(self) -> str:
        """The owner, as the subject of a sentence."""
        return "a node outside the stack" if self.is_external else f"`{self.owner}`"

    @property
    def known_type(self) -> str | None:
        """The type at run time: that of the code if readable, otherwise that of the config."""
        return self.code_type or self.msg_type


@dataclass(frozen=True, slots=True, kw_only=True)
class Topology:
    """Every endpoint of every topic of a stack, computed once for all checks."""

    endpoints: tuple[TopicEndpoint, ...]
    """Endpoints of the nodes, then of joysticks, then of nodes outside the stack."""
    by_node: tuple[tuple[Node, tuple[TopicEndpoint, ...]], ...]
    """Each node with its endpoints; two nodes may share a name by mistake."""
    published: Mapping[str, tuple[TopicEndpoint, ...]]
    """Topic -> its publishers."""
    subscribed: Mapping[str, tuple[TopicEndpoint, ...]]
    """Topic -> its subscribers."""

    @classmethod
    def of(cls, stack: Stack) -> "Topology":
        """The topology of a stack."""
        by_node = tuple((node, tuple(node_endpoints(node))) for node in stack.nodes)
        endpoints = [end for _, of_node in by_node for end in of_node]
        endpoints += [end for joystick in stack.joysticks for end in joystick_endpoints(joystick)]
        endpoints += [end for topic in stack.external_topics for end in _external_endpoints(topic)]
        return cls(
            endpoints=tuple(endpoints),
            by_node=by_node,
            published=_by_topic(endpoints, "publishes"),
            subscribed=_by_topic(endpoints, "subscribes"),
        )


def _by_topic(
    endpoints: Iterable[TopicEndpoint], direction: Direction
) -> Mapping[str, tuple[TopicEndpoint, ...]]:
    topics: dict[str, list[TopicEndpoint]] = defaultdict(list)
    for end in endpoints:
        if end.direction == direction:
            topics[end.topic].append(end)
    return {topic: tuple(of_topic) for topic, of_topic in topics.items()}


def may_be_one(one: str | None, other: str | None) -> bool:
    """Whether two type names are equal or may denote the same type."""
    return one == other or {one, other} == _ONE_SEED_NAME


def stack_endpoints(stack: Stack) -> Iterator[TopicEndpoint]:
    """All endpoints of the stack, node by node."""
    for node in stack.nodes:
        yield from node_endpoints(node)
    for joystick in stack.joysticks:
        yield from joystick_endpoints(joystick)


def joystick_endpoints(joystick: Joystick) -> Iterator[TopicEndpoint]:
    """The endpoints of a joystick's node; by default those of ROS's joystick node."""
    if not joystick.on:
        return
    endpoints: tuple[tuple[Direction, Spanned[str] | None, str, str], ...] = (
        ("publishes", joystick.pub_topic, JOYSTICK_TOPIC, "sensor_msgs/msg/Joy"),
        ("subscribes", joystick.sub_topic, FEEDBACK_TOPIC, "sensor_msgs/msg/JoyFeedback"),
    )
    for direction, written, usual, msg_type in endpoints:
        topic = written or Spanned(usual, joystick.span)
        yield TopicEndpoint(
            direction=direction,
            topic="/" + topic.value.lstrip("/"),
            msg_type=msg_type,
            owner=joystick.full_name,
            section="joystick",
            span=topic.span,
            is_optional=True,
        )


def _external_endpoints(topic: ExternalTopic) -> Iterator[TopicEndpoint]:
    endpoints: tuple[tuple[Direction, str], ...] = (
        ("publishes", "published"),
        ("subscribes", "subscribed"),
    )
    for direction, word in endpoints:
        if topic.may_be(word):
            yield TopicEndpoint(
                direction=direction,
                topic=topic.name,
                msg_type=resolve_msg_type(topic.msg_type.value) if topic.msg_type else None,
                owner=OUTSIDE,
                section="external_topics",
                span=topic.topic.span,
                type_span=topic.msg_type.span if topic.msg_type else None,
                is_optional=True,
            )


def node_endpoints(node: Node) -> Iterator[TopicEndpoint]:
    """The endpoints of a node's components and, for a simulated robot, of its sensor groups."""
    timers = timers_of(node)
    for component in node.used_components:
        if component.kind == "timer" or component.topic is None:
            continue
        period = sending_period_s(component, timers)
        publishes = component.kind == "publisher"
        yield TopicEndpoint(
            direction="publishes" if publishes else "subscribes",
            topic=absolute_topic(component.topic.value, node),
            msg_type=_component_type(component),
            owner=node.full_name,
            section=node.section,
            span=component.topic.span,
            type_span=component.msg_type.span if component.msg_type else None,
            ignores_type=component.ignores_type,
            code_type=component.code_type,
            qos=component.qos,
            rate_hz=1 / period.value if period else None,
            component=component.identity,
            remapping=_remapping_of(_in_namespace(component.topic.value, node), node),
        )
    if node.runs_simulation:
        for sim in node.sims:
            for group in sim.sensor_groups:
                if group.topic.value:
                    yield _sensor_end(group, node)


def timers_of(node: Node) -> Mapping[str | None, Spanned[float] | None]:
    """The periods [s] of a node's timers by their identity."""
    return {c.identity: c.timer_period_s for c in node.used_components if c.kind == "timer"}


def sending_period_s(
    component: Component, timers: Mapping[str | None, Spanned[float] | None]
) -> Spanned[float] | None:
    """The period of the timer that triggers a publisher; None if the config sets none."""
    if component.kind != "publisher":
        return None
    return timers.get(f"timer_{(component.identity or '').removeprefix('pub_')}")


def publisher_of_timer(timer: str) -> str:
    """The identity of the publisher that sends once per period of a timer."""
    return f"pub_{timer.removeprefix('timer_')}"


def _component_type(component: Component) -> str | None:
    written = resolve_msg_type(component.msg_type.value) if component.msg_type else None
    return written or component.code_type or _TYPE_OF_STANDARD.get(component.identity or "")


def _sensor_end(group: SensorGroup, node: Node) -> TopicEndpoint:
    rule = sensor_group(group.msg_type.value) if group.msg_type else None
    return TopicEndpoint(
        direction="publishes",
        topic=absolute_topic(group.topic.value, node),
        msg_type=rule.published if rule else None,
        owner=node.full_name,
        section=node.section,
        span=group.topic.span,
        type_span=group.msg_type.span if group.msg_type else None,
        rate_hz=1 / group.period_s.value if group.period_s else None,
        remapping=_remapping_of(_in_namespace(group.topic.value, node), node),
    )


def absolute_topic(topic: str, node: Node) -> str:
    """The topic's name in the graph, with the node's namespace and remappings applied.

    The first matching remapping applies, however it is written.
    """
    name = _in_namespace(topic, node)
    remapping = _remapping_of(name, node)
    return name if remapping is None else _in_namespace(remapping.new, node)


_MATCH = re.compile(r"(?:(?P<node>\w+):(?!//))?(?:rostopic://)?(?P<topic>[^:]+)")
"""The left side of a rule that may rename topics.

Source: https://design.ros2.org/articles/static_remapping.html (match part of a rule).
"""


def _remapping_of(name: str, node: Node) -> Remapping | None:
    return next((r for r in node.remappings if _renames(r, name, node)), None)


def _renames(remapping: Remapping, name: str, node: Node) -> bool:
    """Whether a remapping applies to a topic of a node; it may be for one node only."""
    match = _MATCH.fullmatch(remapping.old)
    return (
        match is not None
        and match["node"] in (None, node.node_name)
        and _in_namespace(match["topic"], node) == name
    )


def _in_namespace(topic: str, node: Node) -> str:
    if topic.startswith("/"):
        return topic
    if topic.startswith("~"):
        return node.full_name + topic[1:]
    return f"{node.ros_namespace.rstrip('/')}/{topic}"
