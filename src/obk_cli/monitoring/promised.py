"""What a run's plan says of its topics: types, rates, who publishes, what each is made from.

In: the plan as the run's folder keeps it. Out: values; a part that is not as expected is left out.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["PlannedTopic", "planned_topics", "simulated_robots"]

NO_FACTORS: Final[Mapping[str, float]] = {}

_MEASURING: Final = ("robot", "sensing")
"""Sections with which the way of data begins: a robot does not publish what it is commanded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedTopic:
    """A topic of a plan."""

    name: str
    msg_type: str | None
    """Full; None: only the code knows it."""
    wanted_hz: float | None
    """The sum of what its publishers promise, in wall time; None: one of them promises nothing."""
    publishers: tuple[str, ...]
    """Full names of nodes."""
    made_from: tuple[str, ...]
    """Topics that its publishers subscribe to; none where these measure the world."""


def planned_topics(
    plan: Mapping[str, Any], factors: Mapping[str, float] = NO_FACTORS
) -> tuple[PlannedTopic, ...]:
    """The topics of a plan along the way of data: those made from nothing first.

    Args:
        plan: as the run's folder keeps it.
        factors: full name -> real-time factor of simulated robots, where they have told.
    """
    clock = _speed_of_clock(plan, factors)
    kinds: dict[str, str | None] = {}
    promised: defaultdict[str, list[float | None]] = defaultdict(list)
    publishers: defaultdict[str, dict[str, None]] = defaultdict(dict)
    sources: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for process in plan.get("processes", ()):
        node = _full_name(process)
        speed = _speed(process, clock, factors)
        for end in process["subscribes"]:
            kinds[end["topic"]] = kinds.get(end["topic"]) or end["msg_type"]
        for end in process["publishes"]:
            topic = end["topic"]
            kinds[topic] = kinds.get(topic) or end["msg_type"]
            promised[topic].append(_in_wall_time(end["rate_hz"], speed))
            publishers[topic][node] = None
            if process["section"] not in _MEASURING:
                sources[topic].update(dict.fromkeys(one["topic"] for one in process["subscribes"]))
    found = (
        PlannedTopic(
            name=name,
            msg_type=kind,
            wanted_hz=_sum(promised[name]),
            publishers=tuple(publishers[name]),
            made_from=tuple(sources[name]),
        )
        for name, kind in kinds.items()
    )
    return tuple(sorted(found, key=lambda topic: (_depth(topic.name, sources), topic.name)))


def simulated_robots(plan: Mapping[str, Any]) -> tuple[str, ...]:
    """Full names of the robots of a plan that are simulated."""
    return tuple(_full_name(one) for one in plan.get("processes", ()) if one.get("model"))


def _full_name(process: Mapping[str, Any]) -> str:
    return f"{process['namespace'].rstrip('/')}/{process['node']}"


def _speed_of_clock(plan: Mapping[str, Any], factors: Mapping[str, float]) -> float:
    """The speed of `/clock`; 0 where nobody knows it: no robot is simulated, or several differ."""
    simulated = (process for process in plan.get("processes", ()) if process.get("model"))
    speeds = {_speed(process, 0.0, factors) for process in simulated}
    return speeds.pop() if len(speeds) == 1 else 0.0


def _speed(process: Mapping[str, Any], clock: float, factors: Mapping[str, float]) -> float:
    """How fast the time passes in which a node keeps its rates, over wall time; 0: not known."""
    parameters = process.get("parameters", {})
    if process.get("model"):
        planned = float(parameters.get("realtime_factor", 1.0))
        return factors.get(_full_name(process), planned)
    return clock if parameters.get("use_sim_time") else 1.0


def _in_wall_time(rate_hz: float | None, speed: float) -> float | None:
    return rate_hz * speed if rate_hz and speed else None


def _sum(rates: list[float | None]) -> float | None:
    known = [rate for rate in rates if rate is not None]
    return sum(known) if known and len(known) == len(rates) else None


def _depth(topic: str, sources: Mapping[str, Mapping[str, None]]) -> int:
    """How many nodes data has passed when it is published there; a loop is gone through once."""
    seen, layer, depth = {topic}, [topic], 0
    while layer := [up for one in layer for up in sources.get(one, ()) if up not in seen]:
        seen.update(layer)
        depth += 1
    return depth
