"""OBK209 to OBK213, OBK216, OBK220, OBK320: the loop robot -> estimation -> control, its rates, and
the maximum age of a robot's commands.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import inf

from obelisk_spec.components import (
    CONTROL_SUBSCRIPTION,
    ESTIMATE_SUBSCRIPTION,
    standard_component,
)
from obelisk_spec.suggestions import with_number
from obk_cli.check.context import CheckContext, code_of
from obk_cli.check.topics import SHARED_TOPICS
from obk_cli.config.environment import Environment, ModelRead
from obk_cli.config.model import Component, Node, Spanned, Stack
from obk_cli.config.topology import (
    OUTSIDE,
    TopicEndpoint,
    absolute_topic,
    sending_period_s,
    timers_of,
)
from obk_cli.config.tree import plain_value
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found

__all__ = [
    "check_control_topics",
    "check_loop",
    "check_outliers",
    "check_periods",
    "check_timers",
    "check_watchdogs",
]


_HOPS = (
    (("robot", "sensing"), "estimation", "the robot or a sensor"),
    (("estimation",), "control", "an estimator"),
    (("control",), "robot", "a controller"),
)

_SINGLE_SENDERS = (
    ("control", "robot", None, "which commands the robot"),
    ("estimation", "control", ESTIMATE_SUBSCRIPTION, "which a controller uses as its estimate"),
)
"""Sections of the publishers and the subscribers, subscribing component (None: any), purpose."""

_LEAST_RATE, _MOST_RATE = 10.0, 100_000.0
"""A period [s] between these values is more likely to be a rate [Hz]."""
_OUTLIER = 1000
_SLOWEST_SENSOR = 1.0
"""A period [s] that is usual for a sensor next to a 1 kHz loop."""
_LEAST_PERIODS = 3
"""Minimum number of periods to compare a period with the others."""
_LEAST_AGE_PERIODS = 2
"""A command may be late by up to one period."""

Senders = Mapping[str, list[Spanned[float]]]
"""Topic -> periods of the timers that publish on it."""


def check_loop(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that the robot's measurements lead back to its control; skipped if a topic dangles."""
    endpoints = context.topology.endpoints
    senders: dict[str, set[str]] = defaultdict(set)
    for end in endpoints:
        if end.direction == "publishes":
            senders[end.topic].add(end.owner)
    # Topics from outside the stack may come from the robot.
    reached = {node.full_name for s in ("robot", "sensing") for node in context.stack.section(s)}
    reached.add(OUTSIDE)
    for before, section, what in _HOPS:
        nodes = list(context.stack.section(section))
        everyone = {node.full_name for node in nodes}
        earlier = {node.full_name for name in before for node in context.stack.section(name)}
        has_earlier = bool(earlier)
        earlier.add(OUTSIDE)
        subscribers = [e for e in endpoints if e.section == section and e.direction == "subscribes"]
        linked = _reached(subscribers, senders, reached)
        if everyone and has_earlier and not linked and all(e.topic in senders for e in subscribers):
            is_near = bool(_reached(subscribers, senders, earlier))
            yield found(
                "OBK209",
                f"the input of `{section}` does not come from the robot"
                if is_near
                else f"`{section}` receives nothing that {what} publishes",
                nodes[0].span,
                help="the control loop is robot -> estimation -> control -> robot",
            )
        reached = {OUTSIDE, *(linked or everyone)}


def _reached(
    subscribers: list[TopicEndpoint], senders: Mapping[str, set[str]], start: set[str]
) -> set[str]:
    """Owners of `subscribers` that receive from one of `start`, directly or through each other."""
    reached: set[str] = set()
    while True:
        known = start | reached
        more = {e.owner for e in subscribers if not known.isdisjoint(senders.get(e.topic, ()))}
        if more <= reached:
            return reached
        reached |= more


def check_control_topics(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that only one node publishes to each topic of a command or an estimate."""
    endpoints = context.topology.endpoints
    for section, reader, component, purpose in _SINGLE_SENDERS:
        read = {
            end.topic
            for end in endpoints
            if (end.section, end.direction) == (reader, "subscribes")
            and component in (None, standard_component(end.component or ""))
        }
        senders: dict[str, list[TopicEndpoint]] = defaultdict(list)
        for end in endpoints:
            if end.direction == "publishes" and end.section == section and end.topic in read:
                senders[end.topic].append(end)
        for topic, ends in senders.items():
            if topic not in SHARED_TOPICS:
                yield from _several_senders(topic, ends, purpose)


def _several_senders(
    topic: str, senders: list[TopicEndpoint], purpose: str
) -> Iterator[Diagnostic]:
    first, *others = senders
    for other in others:
        if other.owner != first.owner:
            yield found(
                "OBK210",
                f"both `{first.owner}` and `{other.owner}` publish to `{topic}`, {purpose}",
                other.span,
                related=(
                    Related(message="the other one", span=first.span),
                    *first.renamed,
                    *other.renamed,
                ),
            )


def check_timers(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no timer of a node is faster than all of the node's inputs."""
    rates: dict[str, float | None] = {}
    for end in context.topology.endpoints:
        if end.direction == "publishes":
            rates[end.topic] = end.rate_hz if end.topic not in rates else None
    # A wrong period would make every timer after it look too fast.
    reported = {1 / period_s for period_s in _reported_periods_s(context)}
    for node, endpoints in context.topology.by_node:
        inputs = [rates.get(end.topic) for end in endpoints if end.direction == "subscribes"]
        known = [rate for rate in inputs if rate is not None]
        if known and len(known) == len(inputs) and max(known) not in reported:
            yield from _check_node_timers(node, max(known))


def _check_node_timers(node: Node, fastest_hz: float) -> Iterator[Diagnostic]:
    for component in node.components:
        period = component.timer_period_s
        if component.kind == "timer" and period and 1 / period.value > fastest_hz * (1 + 1e-9):
            yield found(
                "OBK211",
                f"timer `{component.identity}` runs at {1 / period.value:g} Hz, but the fastest "
                f"topic that `{node.node_name}` subscribes to is published at {fastest_hz:g} Hz",
                period.span,
            )


def check_periods(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no period is so long that it is probably a rate."""
    for node in context.stack.nodes:
        for name, period, is_loop in _named_periods(node):
            period_s = period.value
            if _looks_like_rate(period_s):
                yield found(
                    "OBK216",
                    f"{name} every {period_s:g} s",
                    period.span,
                    severity=None if is_loop else "info",
                    help=f"periods are in seconds; write {1 / period_s:g} if {period_s:g} Hz was "
                    f"meant, or {period_s / _OUTLIER:g} if {period_s:g} ms was meant",
                )


def _looks_like_rate(period_s: float) -> bool:
    return _LEAST_RATE <= period_s <= _MOST_RATE


def _reported_periods_s(context: CheckContext) -> frozenset[float]:
    """The periods [s] that `check_periods` or `check_outliers` reports as probably wrong."""
    periods = (one[1].value for node in context.stack.nodes for one in _named_periods(node))
    outliers = (outlier.period.value for outlier in _outliers(context))
    return frozenset((*filter(_looks_like_rate, periods), *outliers))


def check_outliers(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no period is 1000 times longer than the others, as if decimals were missing."""
    for outlier in _outliers(context):
        period_s = outlier.period.value
        yield found(
            "OBK220",
            f"{outlier.name} every {period_s:g} s, {outlier.others}",
            outlier.period.span,
            severity=None if outlier.is_loop else "info",
            help=f"write {period_s / _OUTLIER:g} if {period_s:g} ms was meant",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Outlier:
    name: str
    """Subject and verb of the message, such as "timer `x` runs"."""
    period: Spanned[float]
    others: str
    """The periods that it is compared with, as the tail of the message."""
    is_loop: bool


def _outliers(context: CheckContext) -> Iterator[_Outlier]:
    """The longest period if far above all others, and loop periods far above the loop's fastest."""
    periods = [one for node in context.stack.nodes for one in _named_periods(node)]
    if len(periods) < _LEAST_PERIODS:
        return
    longest = max(periods, key=lambda one: one[1].value)
    rest = max(one[1].value for one in periods if one is not longest)
    loop = [one[1].value for one in periods if one[2]]
    fastest = min(loop, default=inf)
    for one in periods:
        name, period, is_loop = one
        if one is longest and period.value >= _OUTLIER * rest:
            others = f"but all other periods are {rest:g} s or less"
        elif is_loop and period.value > _SLOWEST_SENSOR and period.value >= _OUTLIER * fastest:
            others = f"but the shortest period in the loop is {fastest:g} s"
        else:
            continue
        if period.value < _LEAST_RATE:
            yield _Outlier(name=name, period=period, others=others, is_loop=is_loop)


def _named_periods(node: Node) -> Iterator[tuple[str, Spanned[float], bool]]:
    """Subject and verb of each periodic action, its period, and whether it belongs to the loop.

    A custom timer does not, because it may be slow on purpose.
    """
    for component in node.components:
        if component.timer_period_s is not None:
            is_standard = standard_component(component.identity or "") is not None
            yield f"timer `{component.identity}` runs", component.timer_period_s, is_standard
    for sim in node.used_sims:
        for group in sim.sensor_groups:
            if group.period_s is not None:
                yield f"`{group.topic.value}` is published", group.period_s, True


def check_watchdogs(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that maximum ages are set where commands arrive, and allow for the command rate."""
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
    reported = _reported_periods_s(context) if watched else ()
    for component, node in watched:
        if not _has_age(component):
            yield _no_age(component)
            continue
        yield from _check_action(component, node, context.environment)
        if component.max_age_s is not None and component.topic is not None:
            topic = absolute_topic(component.topic.value, node)
            periods = [one for one in senders.get(topic, ()) if one.value not in reported]
            yield from _check_age(component.max_age_s, topic, periods)


def _obeys(component: Component, node: Node) -> bool:
    return node.section == "robot" and component.takes_commands


def _has_age(component: Component) -> bool:
    """Whether an age is written, even if its value is invalid."""
    entry = component.tree.get("max_age_sec")
    return component.max_age_s is not None or (
        entry is not None and plain_value(entry.value) is not None
    )


def _nothing_to_watch(component: Component, node: Node) -> Diagnostic:
    written = component.max_age_s or component.stale_action
    assert written is not None  # the caller checked this
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
    assert component.stale_action is not None  # the caller checked this
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
                "stale commands are replaced by zero, which moves "
                f"{with_number(read.facts.position_servos, 'position servo')} to position zero",
                written.entry_span,
                help="`stale_action: hold` or `damp` keeps the robot where it is",
            )


def _check_damping(
    action: Spanned[str], node: Node, environment: Environment
) -> Iterator[Diagnostic]:
    code = code_of(node, environment)
    if code is not None and code.can_damp is False:
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


def _check_age(
    age: Spanned[float], topic: str, periods: Iterable[Spanned[float]]
) -> Iterator[Diagnostic]:
    for period in periods:
        if age.value < _LEAST_AGE_PERIODS * period.value * (1 - 1e-9):
            yield found(
                "OBK213",
                f"`max_age_sec` is {age.value:g} s, but `{topic}` is published every "
                f"{period.value:g} s, so a single late command triggers `stale_action`",
                age.span,
                help=f"expected at least {_LEAST_AGE_PERIODS * period.value:g} s, two periods",
                related=(Related(message="the timer that publishes", span=period.span),),
            )
