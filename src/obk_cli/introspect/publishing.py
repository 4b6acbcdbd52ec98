"""Check what `obk topic pub` publishes: topic, type, subscribers, and that no robot moves."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obelisk_spec.names import topic_name_fault
from obelisk_spec.suggestions import list_names
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.resolve import find_topic, the_type
from obk_cli.introspect.target import GraphTarget
from obk_cli.ros.graph import TopicInfo

if TYPE_CHECKING:
    from obk_cli.introspect.graph_source import GraphSource
from collections.abc import Iterable

from obk_cli.plan.plan import Plan

__all__ = [
    "Publication",
    "Published",
    "refuse_robot_commands",
    "robots_commanded_by",
    "topic_to_publish",
    "wait_for_subscribers",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Publication:
    """A publication requested by the user."""

    topic: str
    """Full name, or a suffix of one."""
    msg_type: str | None
    """Full, `pkg/msg/Name`; None: the topic's type."""
    message: object
    """Parsed YAML, not checked yet."""
    subscribers: int
    """Number of subscribers to wait for."""
    timeout_s: float
    """Limit for finding the topic and its subscribers [s]."""
    may_move: bool
    """Whether topics that move a robot are allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """The result of publishing."""

    topic: str
    """Full name."""
    count: int
    is_confirmed: bool
    """Whether all reliable subscriptions have received the last message."""


def topic_to_publish(
    source: "GraphSource", target: GraphTarget, publication: Publication
) -> tuple[TopicInfo, str]:
    """The topic and its full type; a new one needs a full name and a type.

    Raises:
        CommandFailedError: no such topic exists, or it has another type.
        MisuseError: the name of a new topic is invalid.
    """
    name, msg_type, timeout_s = publication.topic, publication.msg_type, publication.timeout_s
    if msg_type is None or not name.startswith("/"):
        seen = find_topic(source, target, name, timeout_s, is_published=False)
        msg_type = the_type("topic", seen.name, {msg_type} if msg_type else seen.msg_types)
    else:
        if fault := topic_name_fault(name):
            raise MisuseError(f"`{name}` is not a topic name: {fault}")
        # The subscribers must be known, because they may be robots.
        source.settle(target.nodes, 0.5, timeout_s if target.nodes else 0.5)
        seen = source.topic(name)
    _require_type(seen, msg_type)
    return seen, msg_type


def wait_for_subscribers(
    source: "GraphSource",
    name: str,
    msg_type: str,
    publication: Publication,
    count: Callable[[], int],
) -> None:
    """Wait until a topic has as many subscriptions as the publication requires.

    Args:
        source: the graph.
        name: full name of the topic.
        msg_type: full type of the messages.
        publication: the requested publication.
        count: returns the number of subscriptions.

    Raises:
        CommandFailedError: too few appear in time, or all existing ones have another type.
    """

    def are_there() -> bool | None:
        if count() >= publication.subscribers:
            return True
        _require_type(source.topic(name), msg_type)
        return None

    if not source.wait_for(are_there, publication.timeout_s):
        raise CommandFailedError(
            f"{count()} of {publication.subscribers} subscribers of {name} were found within "
            f"{publication.timeout_s:g} s",
            help="use `--wait-for 0` to publish without subscribers",
        )


def refuse_robot_commands(topic: TopicInfo, target: GraphTarget, option: str) -> None:
    """Reject a publication on a topic that a robot subscribes to.

    Args:
        topic: the topic.
        target: the ROS domain and its running stacks.
        option: the option of the command that allows it.

    Raises:
        CommandFailedError: a robot subscribes to the topic.
    """
    if robots := robots_commanded_by(topic, target.plans):
        raise CommandFailedError(
            f"{topic.name} commands {list_names(robots)}, which is running in the ROS domain "
            f"{target.domain}",
            help=f"to publish anyway, add `{option}`",
        )


def _require_type(topic: TopicInfo, msg_type: str) -> None:
    others = [end.msg_type for end in topic.subscriptions if end.msg_type != msg_type]
    if others and len(others) == len(topic.subscriptions):
        raise CommandFailedError(
            f"{topic.name} has the type {others[0]}, not {msg_type}",
            help="no subscription would receive the messages",
        )


def robots_commanded_by(topic: TopicInfo, plans: Iterable[Plan]) -> tuple[str, ...]:
    """Full names of the robots that subscribe to a topic.

    Args:
        topic: the topic with its ends.
        plans: the plans of stacks that are known to be running.
    """
    planned = (
        node.full_name
        for plan in plans
        for node in plan.nodes
        if node.section == "robot" and any(end.topic == topic.name for end in node.subscribes)
    )
    # Only the nodes' names are known of a stack on another host.
    named = (end.node for end in topic.subscriptions if "/obelisk_robot_" in end.node)
    return tuple(dict.fromkeys((*planned, *named)))
