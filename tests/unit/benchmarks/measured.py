"""Figures of the loop benchmark, made up."""

from benchmarks.loop.figures import Figures

__all__ = ["figures"]


def figures(cpu_percent: float, stolen_percent: float = 0.0) -> Figures:
    """Of a run that took so much of a core; its worst lateness goes with that."""
    return Figures(
        cpu_percent=cpu_percent,
        cpu_per_tick_us=cpu_percent,
        others_percent=0.0,
        stolen_percent=stolen_percent,
        rate_hz=1000.0,
        late_p50_us=20.0,
        late_p99_us=2 * cpu_percent,
        latency_p50_ms=1.0,
        latency_p99_ms=2.0,
    )
