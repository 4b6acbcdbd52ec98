"""Topics that move a robot: whoever publishes on them from outside moves it. Pure."""

from collections.abc import Iterable

from obk_cli.looking.graph import TopicSeen
from obk_cli.plan.plan import Plan

__all__ = ["moved_by"]


def moved_by(topic: TopicSeen, plans: Iterable[Plan]) -> tuple[str, ...]:
    """Full names of the robots that listen to a topic.

    Args:
        topic: with its ends.
        plans: of the stacks that are known to run.
    """
    planned = (
        process.full_name
        for plan in plans
        for process in plan.processes
        if process.section == "robot" and any(end.topic == topic.name for end in process.subscribes)
    )
    # A stack of another host is known by its nodes' names only.
    named = (end.node for end in topic.subscriptions if "/obelisk_robot_" in end.node)
    return tuple(dict.fromkeys((*planned, *named)))
