"""Compute the measures from records: percentiles, lateness, spreads, ratios. Pure."""

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
"""Fraction of a period by which a tick may appear early, as phase and tick are read separately."""
NS_PER_S = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """CPU time during one run, in percent of one core."""

    own: float
    """Used by the nodes' processes."""
    others: float
    """Used by everything else on the machine, including this suite."""
    stolen: float
    """Stolen by the machine's host."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """The measures of one run."""

    cpu_percent: float
    """CPU time of all node processes, in percent of one core."""
    cpu_per_tick_us: float
    """The same per tick of a node; comparable even if ticks were missed."""
    others_percent: float
    """CPU time of everything else on the machine, in percent of one core."""
    stolen_percent: float
    """CPU time that the machine's host stole, in percent of one core."""
    rate_hz: float
    """The rate of the slowest node."""
    late_p50_us: float
    """|actual - scheduled| time of the ticks of all nodes."""
    late_p99_us: float
    latency_p50_ms: float
    """Time from the stamp of a sensor message to the arrival of the control computed from it."""
    latency_p99_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """The spread of one measure over several rounds."""

    median: float
    min: float
    max: float


def figures_of(records: Iterable[NodeRecord], usage: Usage, start_ns: int, end_ns: int) -> Figures:
    """Compute the measures between two times of the monotonic clock [ns].

    Raises:
        ValueError: a node did not tick in this time, or no simulator received a control message.
    """
    late_ns: list[int] = []
    delays_ns: list[int] = []
    rates_hz = []
    for record in records:
        ticks = lateness_ns(record.ticks_ns, period_ns=record.period_ns, phase_ns=record.phase_ns)
        seen = [
            late for at, late in zip(record.ticks_ns, ticks, strict=True) if start_ns <= at < end_ns
        ]
        if not seen:
            raise ValueError(f"{record.name} did not tick")
        late_ns += seen
        rates_hz.append(len(seen) / (end_ns - start_ns) * NS_PER_S)
        delays_ns += [
            delay
            for at, delay in zip(record.arrivals_ns, record.delays_ns, strict=True)
            if start_ns <= at < end_ns
        ]
    if not delays_ns:
        raise ValueError("no simulator received a control message")
    return Figures(
        cpu_percent=usage.own,
        cpu_per_tick_us=usage.own / 100 * (end_ns - start_ns) / len(late_ns) / 1e3,
        others_percent=usage.others,
        stolen_percent=usage.stolen,
        rate_hz=min(rates_hz),
        late_p50_us=percentile(late_ns, 0.50) / 1e3,
        late_p99_us=percentile(late_ns, 0.99) / 1e3,
        latency_p50_ms=percentile(delays_ns, 0.50) / 1e6,
        latency_p99_ms=percentile(delays_ns, 0.99) / 1e6,
    )


def lateness_ns(ticks_ns: Sequence[int], *, period_ns: int, phase_ns: int) -> list[int]:
    """The difference between each tick and its scheduled time.

    A timer that was called late is due again at the next time of its schedule; missed ticks are
    skipped.

    Args:
        ticks_ns: the times of the ticks, in ascending order.
        period_ns: the period of the schedule.
        phase_ns: any time of the schedule.

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
    """The smallest value that is not exceeded by at least this fraction of all values.

    Args:
        values: at least one.
        share: from 0 to 1.
    """
    ordered = sorted(values)
    return ordered[max(0, -int(-share * len(ordered) // 1) - 1)]


def spread(values: Sequence[float]) -> Spread:
    """Median, minimum and maximum of at least one value."""
    return Spread(median=statistics.median(values), min=min(values), max=max(values))


def spreads(rounds: Sequence[Figures]) -> dict[str, Spread]:
    """The spread of each measure over the rounds, by name."""
    return {
        field.name: spread([getattr(figures, field.name) for figures in rounds])
        for field in fields(Figures)
    }


def ratios(
    rounds: Mapping[int, Figures], baseline: Mapping[int, Figures], name: str
) -> Spread | None:
    """A measure relative to the baseline in the same round; None if no round has both.

    Args:
        rounds: measures by round number.
        baseline: measures of the baseline by round number.
        name: the measure.
    """
    both = [
        getattr(rounds[number], name) / getattr(baseline[number], name)
        for number in rounds.keys() & baseline.keys()
        if getattr(baseline[number], name) > 0
    ]
    return spread(both) if both else None
