"""Numbers from what was noted: percentiles, lateness, spreads, ratios. Pure."""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

from benchmarks.loop.record import NodeRecord

__all__ = [
    "Figures",
    "Spread",
    "Usage",
    "figures_of",
    "lateness_ns",
    "percentile",
    "ratios",
    "spread",
    "spreads",
]

EARLY = 0.05
"""Part of a period by which a tick may seem early, as phase and tick are noted a little apart."""
NS_PER_S = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """Processor time of one run, in percent of one core."""

    own: float
    """Of the nodes' processes."""
    others: float
    """Of whatever else the machine did meanwhile, this suite included."""
    stolen: float
    """By the machine's host."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What one run came to."""

    cpu_percent: float
    """Of one core, all processes of the nodes together."""
    cpu_per_tick_us: float
    """The same for each tick of a node: also right where ticks were missed."""
    others_percent: float
    """Of one core, everything else on the machine."""
    stolen_percent: float
    """Of one core, what the machine's host kept from it."""
    rate_hz: float
    """Of the slowest node."""
    late_p50_us: float
    """|actual - scheduled| of the ticks of all nodes."""
    late_p99_us: float
    latency_p50_ms: float
    """From the stamp of a sensor message to the arrival of a control that was made from it."""
    latency_p99_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Of the same figure in several rounds."""

    median: float
    min: float
    max: float


def figures_of(records: Iterable[NodeRecord], usage: Usage, begin_ns: int, end_ns: int) -> Figures:
    """What happened between two moments of the monotonic clock [ns].

    Raises:
        ValueError: a node did not tick in this time, or nothing came back to the simulators.
    """
    late_ns: list[int] = []
    delays_ns: list[int] = []
    rates_hz = []
    for record in records:
        ticks = lateness_ns(record.ticks_ns, period_ns=record.period_ns, phase_ns=record.phase_ns)
        seen = [
            late for at, late in zip(record.ticks_ns, ticks, strict=True) if begin_ns <= at < end_ns
        ]
        if not seen:
            raise ValueError(f"{record.name} did not tick")
        late_ns += seen
        rates_hz.append(len(seen) / (end_ns - begin_ns) * NS_PER_S)
        delays_ns += [
            delay
            for at, delay in zip(record.arrivals_ns, record.delays_ns, strict=True)
            if begin_ns <= at < end_ns
        ]
    if not delays_ns:
        raise ValueError("no control message came back to a simulator")
    return Figures(
        cpu_percent=usage.own,
        cpu_per_tick_us=usage.own / 100 * (end_ns - begin_ns) / len(late_ns) / 1e3,
        others_percent=usage.others,
        stolen_percent=usage.stolen,
        rate_hz=min(rates_hz),
        late_p50_us=percentile(late_ns, 0.50) / 1e3,
        late_p99_us=percentile(late_ns, 0.99) / 1e3,
        latency_p50_ms=percentile(delays_ns, 0.50) / 1e6,
        latency_p99_ms=percentile(delays_ns, 0.99) / 1e6,
    )


def lateness_ns(ticks_ns: Sequence[int], *, period_ns: int, phase_ns: int) -> list[int]:
    """How far each tick was from the moment it was due at.

    A timer that was called late is due again at the next moment of its schedule; what it missed it
    does not make up for.

    Args:
        ticks_ns: when the timer called, in order.
        period_ns: of its schedule.
        phase_ns: any moment of its schedule.

    Source: `rcl_timer_call`, rcl/timer.h of ROS 2 Jazzy.
    """
    late = []
    due_ns: int | None = None
    for tick_ns in ticks_ns:
        shifted = tick_ns + int(EARLY * period_ns)
        latest_ns = shifted - (shifted - phase_ns) % period_ns
        due_ns = latest_ns if due_ns is None else min(due_ns, latest_ns)
        late.append(abs(tick_ns - due_ns))
        due_ns = latest_ns + period_ns
    return late


def percentile(values: Iterable[float], share: float) -> float:
    """The smallest value that at least this share of all does not exceed.

    Args:
        values: at least one.
        share: from 0 to 1.
    """
    ordered = sorted(values)
    return ordered[max(0, -int(-share * len(ordered) // 1) - 1)]


def spread(values: Sequence[float]) -> Spread:
    """Median, least and greatest of at least one value."""
    return Spread(median=statistics.median(values), min=min(values), max=max(values))


def spreads(rounds: Sequence[Figures]) -> dict[str, Spread]:
    """Each figure over the rounds, by name."""
    return {
        field.name: spread([getattr(figures, field.name) for figures in rounds])
        for field in fields(Figures)
    }


def ratios(
    rounds: Mapping[int, Figures], baseline: Mapping[int, Figures], name: str
) -> Spread | None:
    """A figure over that of the baseline in the same round; None where no round has both.

    Args:
        rounds: figures by the number of the round.
        baseline: the same of the baseline.
        name: which figure.
    """
    both = [
        getattr(rounds[number], name) / getattr(baseline[number], name)
        for number in rounds.keys() & baseline.keys()
        if getattr(baseline[number], name) > 0
    ]
    return spread(both) if both else None
