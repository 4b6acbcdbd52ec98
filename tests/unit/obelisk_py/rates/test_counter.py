"""Ticks counted and their lateness read out within the stated resolution."""

from hypothesis import given
from hypothesis import strategies as st

from obelisk_py.core.rates.counter import TickCounter, late_ns_of

US = 1_000
SHARES = (0.5, 0.99, 1.0)
LATE_NS = st.integers(2 * US, 60_000_000 * US)


def counted(late_ns: list[int]) -> TickCounter:
    counter = TickCounter()
    for number, late in enumerate(late_ns):
        counter.tick(number, late)
    return counter


@given(st.lists(LATE_NS, min_size=1, max_size=300))
def test_what_is_read_is_never_too_little_and_at_most_a_sixteenth_too_much(
    late_ns: list[int],
) -> None:
    ordered = sorted(late_ns)
    read = late_ns_of(counted(late_ns).buckets, SHARES)
    for share, found in zip(SHARES, read, strict=True):
        exact = next(x for n, x in enumerate(ordered, start=1) if n >= share * len(ordered))
        assert exact <= found <= exact * 17 / 16


def test_less_than_a_microsecond_is_nothing_and_ahead_of_time_too() -> None:
    assert late_ns_of(counted([-5, 0, 999]).buckets, SHARES) == (0.0, 0.0, 0.0)


def test_hours_of_lateness_are_counted_as_the_longest_there_is() -> None:
    (longest,) = late_ns_of(counted([10**13]).buckets, (1.0,))
    assert longest > 120e9


def test_without_ticks_nothing_is_late() -> None:
    assert late_ns_of(TickCounter().buckets, SHARES) == (0.0, 0.0, 0.0)


def test_ticks_and_those_left_out_are_summed_up() -> None:
    counter = TickCounter()
    counter.tick(1_000, 0)
    counter.tick(5_000, 0, skipped=3)
    assert (counter.ticks, counter.overruns, counter.newest_ns) == (2, 3, 5_000)
