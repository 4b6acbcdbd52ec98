"""OBK209 to OBK211: the loop robot -> estimation -> control -> robot, and how fast it turns."""

from collections import defaultdict
from collections.abc import Iterator

from obk_cli.config import Node, Stack
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.surroundings import Surroundings
from obk_cli.wiring import TopicEnd, node_ends, stack_ends

__all__ = ["check_control_topics", "check_loop", "check_timers"]

_HOPS = (
    (("robot", "sensing"), "estimation", "the robot or a sensor"),
    (("estimation",), "control", "an estimator"),
    (("control",), "robot", "a controller"),
)


def check_loop(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Each block of the loop hears the one before it; not asked where a topic dangles."""
    ends = tuple(stack_ends(stack))
    sources: dict[str, set[str]] = defaultdict(set)
    for end in ends:
        if end.direction == "publishes":
            sources[end.topic].add(end.section)
    for before, section, what in _HOPS:
        nodes = list(stack.section(section))
        heard = [
            sources.get(end.topic)
            for end in ends
            if end.section == section and end.direction == "subscribes"
        ]
        is_linked = any(found_in and found_in.intersection(before) for found_in in heard)
        has_senders = any(True for name in before for _ in stack.section(name))
        if nodes and has_senders and not is_linked and None not in heard:
            message = f"nothing that {what} publishes reaches `{section}`"
            help = "the loop is robot -> estimation -> control -> robot"
            yield found("OBK209", message, nodes[0].span, help=help)


def check_control_topics(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """A topic that the robot obeys has one controller that publishes it."""
    ends = tuple(stack_ends(stack))
    obeyed = {e.topic for e in ends if e.section == "robot" and e.direction == "subscribes"}
    commanders: dict[str, list[TopicEnd]] = defaultdict(list)
    for end in ends:
        if end.direction == "publishes" and end.section == "control" and end.topic in obeyed:
            commanders[end.topic].append(end)
    for topic, (first, *others) in commanders.items():
        for other in others:
            if other.owner != first.owner:
                yield found(
                    "OBK210",
                    f"both `{first.owner}` and `{other.owner}` publish `{topic}`, which the robot "
                    "obeys",
                    other.span,
                    related=(Related(message="the other one", span=first.span),),
                )


def check_timers(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """A node's timer is not faster than everything that the node hears."""
    rates: dict[str, float | None] = {}
    for end in stack_ends(stack):
        if end.direction == "publishes":
            rates[end.topic] = end.rate_hz if end.topic not in rates else None
    for node in stack.nodes:
        inputs = [rates.get(end.topic) for end in node_ends(node) if end.direction == "subscribes"]
        known = [rate for rate in inputs if rate is not None]
        if known and len(known) == len(inputs):
            yield from _check_node_timers(node, max(known))


def _check_node_timers(node: Node, fastest_hz: float) -> Iterator[Diagnostic]:
    for component in node.components:
        period = component.timer_period_s
        if component.kind == "timer" and period and 1 / period.value > fastest_hz * (1 + 1e-9):
            yield found(
                "OBK211",
                f"timer `{component.identity}` runs at {1 / period.value:g} Hz, the fastest topic "
                f"that `{node.node_name}` hears comes at {fastest_hz:g} Hz",
                period.span,
            )
