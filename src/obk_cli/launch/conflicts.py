"""Find conflicts in the ROS domain: duplicate node names, unknown publishers, mismatched types.

A stack starts only if no other node uses its names or publishes commands to its robot. If the
domain is limited to this host and nothing else uses it, there is no such node. Otherwise, nodes
started by obk are found at once; others announce themselves only every 3 s. A simulated robot
therefore starts after a short check, which continues in a thread; a real robot waits for the
whole check. A node that starts publishing during that time with `obk topic pub --allow-foreign` is
allowed.
"""

import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Final

from obk_cli.clock import monotonic_s
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import InputEvent, UnknownPublisherFound
from obk_cli.launch.ros_nodes import RosNodes
from obk_cli.plan.plan import Plan
from obk_cli.process.identity import since_boot_s
from obk_cli.ros.domains import is_used
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.graph import FOREIGN_DISCOVERY_S, OWN_DISCOVERY_S, UNNAMED, RosGraph
from obk_cli.ros.publisher import is_allowed_publisher

__all__ = [
    "control_topics",
    "has_hardware",
    "may_have_others",
    "refuse_taken_names",
    "refuse_unknown_publishers",
    "watching_publishers",
    "watching_types",
]

PUBLISHERS_PERIOD_S: Final = 0.1
TYPES_PERIOD_S: Final = 1.0
_COMMANDS: Final = "now commands the robot, too: it publishes on"
NAMING_CHECKS: Final = 4
"""Number of checks after which an endpoint is reported without its node's name, which DDS sends
later."""


def may_have_others(environment: RosEnvironment) -> bool:
    """Whether nodes of others may exist; call this before the run's own processes start."""
    return not environment.is_local or is_used(environment.domain)


def refuse_taken_names(names: tuple[str, ...], ros: RosNodes, domain: int) -> None:
    """Reject a launch if nodes with these full names exist, on any host and however started.

    Raises:
        CommandFailedError: at least one such node exists.
    """
    taken = ros.taken(names, OWN_DISCOVERY_S)
    if taken:
        raise CommandFailedError(
            f"already in use in ROS domain {domain}: {', '.join(taken)}",
            help="stop these nodes or use another ROS_DOMAIN_ID; "
            "`obk lifecycle get` shows the nodes",
        )


def refuse_unknown_publishers(plan: Plan, ros: RosNodes, domain: int) -> None:
    """Reject a launch if another node publishes on the topics that move the robot.

    Raises:
        CommandFailedError: a publisher is not a node of the plan.
    """
    wait_s = FOREIGN_DISCOVERY_S if has_hardware(plan) else OWN_DISCOVERY_S
    unknown = ros.foreign_publishers(control_topics(plan), _names(plan), wait_s)
    if unknown:
        who = ", ".join(f"{node} publishes on {topic}" for topic, node in unknown)
        raise CommandFailedError(
            f"another node is publishing robot commands in ROS domain {domain}: {who}",
            help="stop it, use another ROS_DOMAIN_ID, or allow it with `--allow-foreign`",
        )


def watching_publishers(
    plan: Plan,
    ros: RosNodes,
    on_event: Callable[[InputEvent], None],
    note: Callable[[str], None],
) -> AbstractContextManager[None]:
    """Inside the `with` block, report unknown publishers on the robot's topics.

    Args:
        plan: the stack.
        ros: discovers the publishers.
        on_event: receives those that may have existed before the launch, which ends the run.
        note: receives a warning for each one that appears later.
    """
    begin_s = since_boot_s()
    # A command that has ended stays in the graph a little longer.
    allowed: set[str] = set()

    def is_unknown(node: str) -> bool:
        if is_allowed_publisher(node, begin_s):
            allowed.add(node)
        # A node without a name may be a node of ours that has just started.
        return node != UNNAMED and node not in allowed

    def check(is_over: threading.Event) -> None:
        end = monotonic_s() + FOREIGN_DISCOVERY_S
        noted: set[tuple[str, str]] = set()
        period_s = PUBLISHERS_PERIOD_S
        while not is_over.wait(period_s):
            seen = ros.foreign_publishers(control_topics(plan), _names(plan), 0.0)
            found = [publisher for publisher in seen if is_unknown(publisher[1])]
            if monotonic_s() > end:
                period_s = TYPES_PERIOD_S
                for topic, node in found:
                    if (topic, node) not in noted:
                        noted.add((topic, node))
                        note(
                            f"warning: {node}, which is not part of this stack, {_COMMANDS} {topic}"
                        )
            elif found:
                for topic, node in found:
                    on_event(UnknownPublisherFound(topic=topic, node=node))
                return

    return _background_thread(check, "publishers")


def control_topics(plan: Plan) -> tuple[str, ...]:
    """The topics that the plan's robots subscribe to, without `external_topics`."""
    robots = (node for node in plan.nodes if node.section == "robot")
    topics = dict.fromkeys(end.topic for robot in robots for end in robot.subscribes)
    return tuple(topic for topic in topics if topic not in plan.external_topics)


def has_hardware(plan: Plan) -> bool:
    """Whether a robot of a plan is not simulated."""
    return any(node.section == "robot" and node.model is None for node in plan.nodes)


def _names(plan: Plan) -> tuple[str, ...]:
    return tuple(node.full_name for node in plan.nodes)


def watching_types(
    plan: Plan, graph: RosGraph, note: Callable[[str], None]
) -> AbstractContextManager[None]:
    """Inside the `with` block, report each conflicting type on a topic once, with its nodes.

    DDS connects only endpoints of the same type and does not report mismatches: if a node
    publishes a `String` on a robot's control topic, its messages do not arrive.
    """
    expected = _types_of(plan)

    def check(is_over: threading.Event) -> None:
        reported: set[tuple[str, str]] = set()
        checks: Counter[tuple[str, str]] = Counter()
        while not is_over.wait(TYPES_PERIOD_S):
            for topic, other in _others(expected, graph.topic_types()):
                if (topic, other) in reported:
                    continue
                checks[topic, other] += 1
                ends = graph.ends_of_type(topic, other)
                if UNNAMED not in ends or checks[topic, other] == NAMING_CHECKS:
                    reported.add((topic, other))
                    note(_sentence(topic, expected[topic], other, ends))

    return _background_thread(check, "types")


def _types_of(plan: Plan) -> Mapping[str, str]:
    """Topic -> full type; topics whose type only the code defines are omitted."""
    ends = (end for node in plan.nodes for end in (*node.publishes, *node.subscribes))
    return {end.topic: end.msg_type for end in ends if end.msg_type is not None}


def _others(
    expected: Mapping[str, str], found: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str]]:
    for topic, mine in expected.items():
        for other in found.get(topic, ()):
            if other != mine:
                yield topic, other


def _sentence(topic: str, mine: str, other: str, ends: Sequence[str]) -> str:
    who = ", ".join(ends) or "another node"
    return (
        f"warning: {topic} has the type {mine} in this stack and {other} in {who}: "
        "these nodes do not receive each other's messages"
    )


@contextmanager
def _background_thread(check: Callable[[threading.Event], None], name: str) -> Iterator[None]:
    """Inside the `with` block, run `check` in a thread; it returns soon after its event is set."""
    is_over = threading.Event()
    thread = threading.Thread(target=check, args=(is_over,), name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
