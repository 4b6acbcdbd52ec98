"""Who else is in the ROS domain: a stack starts only where nobody has its names or its robot.

Nodes that obk started are found at once; others announce themselves every 3 s only. So a simulated
robot starts after a short look and the rest of the look goes on beside it, and a real one waits.
Who begins to publish during that rest with `obk topic pub --allow-foreign` is no stranger.
"""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from obk_cli.adapters.allowed_publisher import is_allowed_publisher
from obk_cli.adapters.clock import monotonic_s
from obk_cli.adapters.process_start import since_boot_s
from obk_cli.adapters.ros_graph import FOREIGN_DISCOVERY_S, OWN_DISCOVERY_S, UNNAMED
from obk_cli.adapters.ros_lifecycle import RosLifecycle
from obk_cli.errors import CommandFailedError
from obk_cli.launch.events import Heard, StrangerSeen
from obk_cli.plan.plan import Plan
from obk_cli.running.beside import beside

__all__ = ["control_topics", "has_hardware", "looking_on", "refuse_strangers", "refuse_taken_names"]

LOOK_S: Final = 0.1


def refuse_taken_names(names: tuple[str, ...], ros: RosLifecycle, domain: int) -> None:
    """Look for nodes of these full names: started on another host, or without obk.

    Raises:
        CommandFailedError: there are some.
    """
    taken = ros.taken(names, OWN_DISCOVERY_S)
    if taken:
        raise CommandFailedError(
            f"in the ROS domain {domain} there is already {', '.join(taken)}",
            help="stop what runs there or use another ROS_DOMAIN_ID; "
            "`obk lifecycle get` shows the nodes",
        )


def refuse_strangers(plan: Plan, ros: RosLifecycle, domain: int) -> None:
    """Look for publishers on the topics that move the robot.

    Raises:
        CommandFailedError: there is one that is none of the plan's nodes.
    """
    wait_s = FOREIGN_DISCOVERY_S if has_hardware(plan) else OWN_DISCOVERY_S
    strangers = ros.foreign_publishers(control_topics(plan), _names(plan), wait_s)
    if strangers:
        who = ", ".join(f"{node} publishes on {topic}" for topic, node in strangers)
        raise CommandFailedError(
            f"in the ROS domain {domain} somebody else moves the robot: {who}",
            help="end that, use another ROS_DOMAIN_ID, or let it with `--allow-foreign`",
        )


def looking_on(
    plan: Plan, ros: RosLifecycle, hear: Callable[[Heard], None]
) -> AbstractContextManager[None]:
    """While entered, tell of a publisher on the robot's topics that is found only now."""
    begin_s = since_boot_s()
    # A command that has ended is in the graph for a moment yet.
    allowed: set[str] = set()

    def is_stranger(node: str) -> bool:
        if is_allowed_publisher(node, begin_s):
            allowed.add(node)
        # One without a name may be a node of ours that has just come.
        return node != UNNAMED and node not in allowed

    def look(is_over: threading.Event) -> None:
        end = monotonic_s() + FOREIGN_DISCOVERY_S
        found: tuple[tuple[str, str], ...] = ()
        while not found and monotonic_s() < end and not is_over.wait(LOOK_S):
            seen = ros.foreign_publishers(control_topics(plan), _names(plan), 0.0)
            found = tuple(publisher for publisher in seen if is_stranger(publisher[1]))
        for topic, node in found:
            hear(StrangerSeen(topic=topic, node=node))

    return beside(look, "strangers")


def control_topics(plan: Plan) -> tuple[str, ...]:
    """The topics that the robots of a plan listen to."""
    robots = (node for node in plan.processes if node.section == "robot")
    return tuple(dict.fromkeys(end.topic for robot in robots for end in robot.subscribes))


def has_hardware(plan: Plan) -> bool:
    """Whether a robot of a plan is not simulated."""
    return any(node.section == "robot" and node.model is None for node in plan.processes)


def _names(plan: Plan) -> tuple[str, ...]:
    return tuple(node.full_name for node in plan.processes)
