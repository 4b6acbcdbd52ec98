"""OBK212, OBK213, OBK320: how old a robot's commands may become, and what is done then."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

from obelisk_spec.components import CONTROL_SUBSCRIPTION
from obk_cli.check.context import CheckContext
from obk_cli.config.environment import Environment, ModelRead, NodeFacts
from obk_cli.config.model import Component, Node, Spanned, Stack
from obk_cli.config.topology import absolute_topic, sending_period_s, timers_of
from obk_cli.config.tree import plain_value
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found

__all__ = ["check_watchdogs"]

_LEAST_PERIODS = 2
"""A command may be late by one period before it is missed."""

Senders = Mapping[str, list[Spanned[float]]]
"""Topic -> the periods of the timers that send on it."""


def check_watchdogs(context: CheckContext) -> Iterator[Diagnostic]:
    """Ages are watched where commands come in, and allow for the pace at which they are sent."""
    watched: list[tuple[Component, Node]] = []
    for node in context.stack.nodes:
        for component in node.components:
            if component.max_age_s is None and component.stale_action is None:
                continue
            if _obeys(component, node):
                watched.append((component, node))
            else:
                yield _nothing_to_watch(component, node)
    senders = _senders(context.stack) if watched else {}
    for component, node in watched:
        if not _has_age(component):
            yield _no_age(component)
            continue
        yield from _check_action(component, node, context.environment)
        if component.max_age_s is not None and component.topic is not None:
            topic = absolute_topic(component.topic.value, node)
            yield from _check_age(component.max_age_s, topic, senders)


def _obeys(component: Component, node: Node) -> bool:
    return node.section == "robot" and component.takes_commands


def _has_age(component: Component) -> bool:
    """Whether an age is written, though it may be none that can be used."""
    entry = component.tree.get("max_age_sec")
    return component.max_age_s is not None or (
        entry is not None and plain_value(entry.value) is not None
    )


def _nothing_to_watch(component: Component, node: Node) -> Diagnostic:
    written = component.max_age_s or component.stale_action
    assert written is not None  # what the caller looked for
    key = "max_age_sec" if component.max_age_s else "stale_action"
    name = f" `{component.identity}`" if component.identity else ""
    return found(
        "OBK212",
        f"`{key}` has no effect on the {component.kind}{name} of `{node.node_name}`",
        written.entry_span,
        help=f"set it on a robot's subscriber `{CONTROL_SUBSCRIPTION}`, which receives the "
        "commands",
    )


def _no_age(component: Component) -> Diagnostic:
    assert component.stale_action is not None  # what the caller looked for
    return found(
        "OBK212",
        "`stale_action` has no effect without `max_age_sec`",
        component.stale_action.entry_span,
        help="add `max_age_sec`, the maximum age of a command in seconds",
    )


def _check_action(
    component: Component, node: Node, environment: Environment
) -> Iterator[Diagnostic]:
    action = component.stale_action
    if action is not None and action.value == "damp":
        yield from _check_damping(action, node, environment)
    written = action or component.max_age_s
    if written is None or (action is not None and action.value != "zero"):
        return
    for sim in node.sims if node.runs_simulation else ():
        if not sim.is_sound or sim.model is None or sim.model.found is None:
            continue
        read = environment.read_model(sim.model.found)
        if isinstance(read, ModelRead) and read.facts.position_servos:
            yield found(
                "OBK320",
                "stale commands are replaced by zero, which is the position 0 for "
                f"{read.facts.position_servos} of the model's {read.facts.actuators} actuators",
                written.entry_span,
                help="`stale_action: hold` or `damp` keeps the robot where it is",
            )


def _check_damping(
    action: Spanned[str], node: Node, environment: Environment
) -> Iterator[Diagnostic]:
    if node.pkg is None or node.executable is None:
        return
    code = environment.read_node_code(node.pkg.value, node.executable.value)
    if isinstance(code, NodeFacts) and code.can_damp is False:
        yield found(
            "OBK212",
            f"class `{code.class_name}` does not implement `apply_damping`, so it cannot `damp`",
            action.span,
            help="implement it, or use `zero` or `hold`",
            related=(Related(message="the class", span=code.span),),
        )


def _senders(stack: Stack) -> Senders:
    periods: dict[str, list[Spanned[float]]] = defaultdict(list)
    for node in stack.nodes:
        timers = timers_of(node)
        for component in node.components:
            period = sending_period_s(component, timers)
            if period is not None and component.topic is not None:
                periods[absolute_topic(component.topic.value, node)].append(period)
    return periods


def _check_age(age: Spanned[float], topic: str, senders: Senders) -> Iterator[Diagnostic]:
    for period in senders.get(topic, ()):
        if age.value < _LEAST_PERIODS * period.value * (1 - 1e-9):
            yield found(
                "OBK213",
                f"`max_age_sec` is {age.value:g} s, `{topic}` is published every "
                f"{period.value:g} s, so a single late command triggers `stale_action`",
                age.span,
                help=f"expected at least {_LEAST_PERIODS * period.value:g} s, two periods",
                related=(Related(message="the timer that publishes", span=period.span),),
            )
