"""Topics of a stack on which somebody has another message type, told as soon as they are found.

DDS connects ends of one type only and says nothing of others: whoever publishes a `String` where a
robot waits for controls is heard by nobody and would never know why.
"""

import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Final

from obk_cli.adapters.ros_graph import UNNAMED, RosGraph
from obk_cli.plan.plan import Plan
from obk_cli.running.beside import beside

__all__ = ["other_types_told"]

LOOK_S: Final = 1.0
NAMING_LOOKS: Final = 4
"""The look by which an end is told without its node's name, which DDS brings after the end."""


def other_types_told(
    plan: Plan, graph: RosGraph, tell: Callable[[str], None]
) -> AbstractContextManager[None]:
    """While entered, tell once of each other type on a topic of the plan, and who has it."""
    wanted = _types_of(plan)

    def look(is_over: threading.Event) -> None:
        told: set[tuple[str, str]] = set()
        looks: Counter[tuple[str, str]] = Counter()
        while not is_over.wait(LOOK_S):
            for topic, other in _others(wanted, graph.topic_types()):
                if (topic, other) in told:
                    continue
                looks[topic, other] += 1
                ends = graph.ends_of_type(topic, other)
                if UNNAMED not in ends or looks[topic, other] == NAMING_LOOKS:
                    told.add((topic, other))
                    tell(_sentence(topic, wanted[topic], other, ends))

    return beside(look, "types")


def _types_of(plan: Plan) -> Mapping[str, str]:
    """Topic -> full type; those of which only the code knows the type are left out."""
    ends = (end for node in plan.processes for end in (*node.publishes, *node.subscribes))
    return {end.topic: end.msg_type for end in ends if end.msg_type is not None}


def _others(
    wanted: Mapping[str, str], found: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str]]:
    for topic, mine in wanted.items():
        for other in found.get(topic, ()):
            if other != mine:
                yield topic, other


def _sentence(topic: str, mine: str, other: str, ends: Sequence[str]) -> str:
    who = ", ".join(ends) or "somebody"
    return (
        f"warning: {topic} is a topic of {mine} here, and {who} has it as {other}: "
        "none of these messages get through"
    )
