"""The figures of the loop benchmark are those of the ticks and messages that were noted."""

import pytest

from benchmarks.loop.figures import (
    Spread,
    Usage,
    figures_of,
    lateness_ns,
    percentile,
    ratios,
    spread,
)
from benchmarks.loop.record import NodeRecord

from .measured import figures

PERIOD_NS = 1000
USAGE = Usage(own=50.0, others=10.0, stolen=3.0)


def late(*ticks_ns: int, phase_ns: int = 0) -> list[int]:
    return lateness_ns(ticks_ns, period_ns=PERIOD_NS, phase_ns=phase_ns)


def record(name: str = "sim_0", **noted: tuple[int, ...]) -> NodeRecord:
    times = {"ticks_ns": (), "arrivals_ns": (), "delays_ns": (), **noted}
    return NodeRecord(name=name, period_ns=PERIOD_NS, phase_ns=0, **times)


def test_a_tick_is_late_by_what_it_is_behind_its_schedule() -> None:
    assert late(10, 1005, 2300) == [10, 5, 300]


def test_the_schedule_goes_on_from_any_moment_of_it_before_or_after_the_ticks() -> None:
    assert late(110, 1105, phase_ns=5100) == late(110, 1105, phase_ns=-3900) == [10, 5]


def test_a_tick_that_is_late_by_periods_is_not_taken_for_one_in_time() -> None:
    # Due at 1000, called at 3600; due again at 4000.
    assert late(0, 3600, 4001) == [0, 2600, 1]


def test_a_tick_noted_just_before_its_moment_is_not_late_by_a_period() -> None:
    assert late(0, 990, 1999) == [0, 10, 1]


def test_two_ticks_within_a_period_are_held_against_the_same_moment() -> None:
    # The first of them was called in time for its own period, and noted only in the next.
    assert late(0, 2005, 2010) == [0, 1005, 10]


def test_a_percentile_is_a_value_that_was_seen() -> None:
    values = [float(value) for value in range(1, 101)]
    assert [percentile(values, share) for share in (0.0, 0.5, 0.99, 1.0)] == [1, 50, 99, 100]
    assert percentile([7.0], 0.99) == 7.0
    assert percentile([3.0, 1.0, 2.0], 0.5) == 2.0


def test_a_spread_has_the_median_and_both_ends() -> None:
    assert spread([3.0, 9.0, 1.0]) == Spread(median=3.0, min=1.0, max=9.0)


def test_only_what_happened_in_the_window_counts() -> None:
    records = [
        record(
            ticks_ns=(900, 1010, 2020, 3000, 4000),
            arrivals_ns=(999, 1500, 2500, 4000),
            delays_ns=(9_000_000, 1_000_000, 3_000_000, 9_000_000),
        ),
        record("est_0", ticks_ns=(0, 1000, 3000)),
    ]
    found = figures_of(records, USAGE, 1000, 4000)
    assert found.cpu_percent == 50.0
    assert found.cpu_per_tick_us == pytest.approx(0.5 * 3.0 / 5)  # half of 3 us, five ticks
    assert (found.others_percent, found.stolen_percent) == (10.0, 3.0)
    assert found.rate_hz == pytest.approx(2 / 3000e-9)  # of est_0, the slower
    assert (found.latency_p50_ms, found.latency_p99_ms) == (1.0, 3.0)
    assert found.late_p99_us == pytest.approx(1.0)  # est_0 missed 2000 and came at 3000


def test_a_node_that_stands_still_is_no_figure() -> None:
    records = [record(ticks_ns=(1000,), arrivals_ns=(1000,), delays_ns=(1,)), record("ctrl_0")]
    with pytest.raises(ValueError, match="ctrl_0 did not tick"):
        figures_of(records, USAGE, 0, 2000)


def test_a_ring_that_nothing_goes_round_is_no_figure() -> None:
    with pytest.raises(ValueError, match="no control message came back"):
        figures_of([record(ticks_ns=(1000,))], USAGE, 0, 2000)


def test_a_ratio_is_taken_within_a_round_and_only_where_it_has_both() -> None:
    own = {0: figures(20.0), 1: figures(90.0), 2: figures(30.0)}
    baseline = {0: figures(100.0), 2: figures(60.0)}
    assert ratios(own, baseline, "cpu_percent") == Spread(median=0.35, min=0.2, max=0.5)
    assert ratios({1: figures(1.0)}, baseline, "cpu_percent") is None
