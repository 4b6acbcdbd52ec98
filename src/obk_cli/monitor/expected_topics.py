"""The topics, rates and real-time factors that a plan expects, to compare with a running stack."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obelisk_spec.sim_block import REALTIME_FACTOR
from obk_cli.errors import CommandFailedError
from obk_cli.plan.plan import Plan, PlannedNode
from obk_cli.ros.parameters import NodeParameter
from obk_cli.runs.lifecycle import ACTIVE, INACTIVE
from obk_cli.runs.protocol import NodeStatus

__all__ = [
    "PlannedTopic",
    "RealtimeFactors",
    "planned_topics",
    "simulated_robots",
]

AskFactor = Callable[[str], NodeParameter]
"""Queries a node (full name) for the parameter; raises CommandFailedError without an answer."""


class RealtimeFactors:
    """The real-time factors of the simulated robots of one stack."""

    def __init__(self, simulated: Collection[str], ask: AskFactor) -> None:
        """Start without factors.

        Args:
            simulated: full names of the robots.
            ask: queries one of them.
        """
        self._simulated = simulated
        self._ask = ask
        self._known: dict[str, float] = {}

    @property
    def factors(self) -> Mapping[str, float]:
        """Full name -> factor of the configured robots that have answered."""
        return dict(self._known)

    def take_event(self, _received_ns: int, event: bytes) -> None:
        """Process a serialized `ParameterEvent` of any node."""
        if REALTIME_FACTOR.encode() in event:
            self._known.clear()

    def query_missing(self, nodes: Iterable[NodeStatus]) -> None:
        """Query the configured robots whose factor is not known yet."""
        for node in nodes:
            is_configured = node.state in (INACTIVE, ACTIVE)
            if node.node in self._simulated and is_configured and node.node not in self._known:
                self._query(node.node)

    def _query(self, node: str) -> None:
        try:
            value = self._ask(node).value
        except CommandFailedError:
            return  # the next call queries again
        if isinstance(value, int | float):
            self._known[node] = float(value)


NO_FACTORS: Final[Mapping[str, float]] = {}

KEEPS_UP: Final = 0.98
"""Minimum fraction of its factor at which a simulation counts as fast enough."""
_MEASURING: Final = ("robot", "sensing")
"""Sections at the start of the data flow; a robot's commands do not count as its sources."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTopic:
    """A topic of a plan."""

    name: str
    msg_type: str | None
    """Full name; None if only the code knows it."""
    expected_hz: float | None
    """Sum of its publishers' expected rates, in wall time; None if one of them has none."""
    publishers: tuple[str, ...]
    """Full names of nodes."""
    made_from: tuple[str, ...]
    """Topics that its publishers subscribe to; empty if they measure the world."""


def planned_topics(
    plan: Plan,
    factors: Mapping[str, float] = NO_FACTORS,
    measured: Mapping[str, float] = NO_FACTORS,
) -> tuple[PlannedTopic, ...]:
    """The topics of a plan in the order of the data flow: those without sources first.

    Args:
        plan: the whole stack.
        factors: full name -> real-time factor of simulated robots, as far as known.
        measured: the measured factors. A simulation that is too slow also slows everything on its
            time; only its `steps` rate is at fault.
    """
    factors = {
        name: _reached(_factor_of(node, 0.0, factors), measured.get(name))
        for node in plan.nodes
        if node.model and (name := node.full_name)
    }
    clock = _clock_factor(plan, factors)
    kinds: dict[str, str | None] = {}
    expected: defaultdict[str, list[float | None]] = defaultdict(list)
    publishers: defaultdict[str, dict[str, None]] = defaultdict(dict)
    sources: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for node in plan.nodes:
        factor = _factor_of(node, clock, factors)
        for end in node.subscribes:
            kinds[end.topic] = kinds.get(end.topic) or end.msg_type
        for end in node.publishes:
            kinds[end.topic] = kinds.get(end.topic) or end.msg_type
            expected[end.topic].append(_in_wall_time(end.rate_hz, factor))
            publishers[end.topic][node.full_name] = None
            if node.section not in _MEASURING:
                sources[end.topic].update(dict.fromkeys(one.topic for one in node.subscribes))
    found = (
        PlannedTopic(
            name=name,
            msg_type=kind,
            expected_hz=_sum(expected[name]),
            publishers=tuple(publishers[name]),
            made_from=tuple(sources[name]),
        )
        for name, kind in kinds.items()
    )
    return tuple(sorted(found, key=lambda topic: (_depth(topic.name, sources), topic.name)))


def simulated_robots(plan: Plan) -> tuple[str, ...]:
    """Full names of the simulated robots of a plan."""
    return tuple(node.full_name for node in plan.nodes if node.model)


def _clock_factor(plan: Plan, factors: Mapping[str, float]) -> float:
    """The speed of `/clock`; 0 if unknown: no simulated robot, or several that differ."""
    simulated = (node for node in plan.nodes if node.model)
    factors_found = {_factor_of(node, 0.0, factors) for node in simulated}
    return factors_found.pop() if len(factors_found) == 1 else 0.0


def _factor_of(node: PlannedNode, clock: float, factors: Mapping[str, float]) -> float:
    """How fast a node's time base runs, relative to wall time; 0 if unknown."""
    if node.model:
        planned = node.parameters.get(REALTIME_FACTOR, 1.0)
        # A robot rejects values that are not numbers; its factor is unknown then.
        own = float(planned) if isinstance(planned, int | float) else 0.0
        return factors.get(node.full_name, own)
    return clock if node.parameters.get(USE_SIM_TIME) else 1.0


def _reached(planned: float, measured: float | None) -> float:
    """The planned factor, unless the simulation is slower."""
    return planned if measured is None or measured >= KEEPS_UP * planned else measured


def _in_wall_time(rate_hz: float | None, factor: float) -> float | None:
    return rate_hz * factor if rate_hz and factor else None


def _sum(rates: list[float | None]) -> float | None:
    known = [rate for rate in rates if rate is not None]
    return sum(known) if known and len(known) == len(rates) else None


def _depth(topic: str, sources: Mapping[str, Mapping[str, None]]) -> int:
    """Number of nodes that data passes before it reaches a topic; loops count once."""
    seen, layer, depth = {topic}, [topic], 0
    while layer := [up for one in layer for up in sources.get(one, ()) if up not in seen]:
        seen.update(layer)
        depth += 1
    return depth
