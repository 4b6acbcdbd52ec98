"""Ticks, their lateness and the expected rate, with a clock controlled by the test."""

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obelisk_py.core.rate_monitor import (
    ExpectedRate,
    SampleTicks,
    TickCounter,
    TimerTicks,
    late_ns_of,
)
from obelisk_spec.runtime_protocol import Rate

S = 1_000_000_000
MS = 1_000_000


class _World:
    """A clock, a counter, an expected rate; the ticks of a second happen before it is read."""

    def __init__(self, expected_hz: float) -> None:
        self.now_ns: int | None = 10 * S
        self.steady_s = 3.0
        self.counter = TickCounter()
        self.rate = ExpectedRate(
            name="timer_ctrl",
            expected_hz=expected_hz,
            counter=self.counter,
            clock=lambda: self.now_ns,
            steady_s=lambda: self.steady_s,
        )

    def second(self, ticks_ms: Iterable[float] = (), late_ns: int = 0) -> Rate:
        """Simulate a second with ticks at these times after its start [ms]."""
        return self.after(1.0, ticks_ms, late_ns)

    def after(self, seconds: float, ticks_ms: Iterable[float] = (), late_ns: int = 0) -> Rate:
        """The rate read after a time other than a second."""
        assert self.now_ns is not None
        for tick_ms in ticks_ms:
            self.counter.tick(self.now_ns + round(tick_ms * MS), late_ns)
        self.now_ns += round(seconds * S)
        self.steady_s += seconds
        return self.rate.read()


def every(period_ms: float, first_ms: float | None = None) -> list[float]:
    """The times of a second's ticks [ms]."""
    first = period_ms if first_ms is None else first_ms
    count = int((1000 - first) / period_ms) + 1
    return [first + n * period_ms for n in range(count)]


def test_a_timer_on_its_schedule_keeps_its_rate() -> None:
    world = _World(100.0)
    for _ in range(5):
        rate = world.second(every(10), late_ns=500_000)
        assert (rate.measured_hz, rate.standing) == (pytest.approx(100.0), "kept")
    assert (rate.ticks, rate.overruns) == (500, 0)
    assert 500 <= rate.late_p50_us == rate.late_max_us <= 532


def test_the_first_second_is_forgiven_the_next_is_off_and_two_are_broken() -> None:
    world = _World(100.0)
    assert [world.second(every(20)).standing for _ in range(4)] == [
        "kept",
        "off",
        "broken",
        "broken",
    ]


@pytest.mark.parametrize(
    ("reads_s", "standings"),
    [
        ((0.97, 0.98), ["off", "broken"]),
        ((0.3, 1.0, 1.0), ["off", "off", "broken"]),
        ((1.0, 0.6, 0.5), ["off", "off", "broken"]),
        ((1.4, 0.6, 1.0), ["off", "off", "broken"]),
        ((5.0, 1.0), ["off", "broken"]),
    ],
)
def test_a_broken_rate_was_off_for_two_seconds_for_any_times_of_reading(
    reads_s: tuple[float, ...], standings: list[str]
) -> None:
    world = _World(100.0)
    world.second(every(10))
    assert [world.after(read_s).standing for read_s in reads_s] == standings


def test_one_good_second_is_enough_to_keep_a_rate_again() -> None:
    world = _World(100.0)
    for _ in range(3):
        broken = world.second(every(20))
    assert broken.standing == "broken"
    assert world.second(every(10)).standing == "kept"
    assert world.second(every(20)).standing == "off"


@pytest.mark.parametrize(("period_ms", "standing"), [(10.9, "kept"), (11.2, "off")])
def test_a_tenth_is_the_limit(period_ms: float, standing: str) -> None:
    world = _World(100.0)
    world.second(every(10))
    assert world.second(every(period_ms, first_ms=period_ms)).standing == standing


def test_a_timer_that_stops_is_off_although_its_last_ticks_were_in_time() -> None:
    world = _World(100.0)
    world.second(every(10))
    rate = world.second([10, 20, 30])
    assert rate.standing == "off"
    assert rate.measured_hz == pytest.approx(4.0)
    assert world.second().measured_hz < 1.1
    assert world.second().standing == "broken"


def test_ticks_are_not_split_by_the_reading() -> None:
    """A timer of 3 Hz has three or four ticks in a second."""
    world = _World(3.0)
    for n in range(6):
        ticks = [t - 1000 * n for t in [m * 1000 / 3 + 30 for m in range(100)]]
        rate = world.second([t for t in ticks if 0 <= t < 1000])
        assert rate.standing == "kept"
        assert n == 0 or rate.measured_hz == pytest.approx(3.0)


def test_a_timer_slower_than_the_reports_is_not_off_between_its_ticks() -> None:
    world = _World(0.25)
    seconds = [[], [], [], [999]] * 4
    assert {world.second(ticks).standing for ticks in seconds} == {"kept"}
    seen = [world.second().standing for _ in range(6)]
    assert seen[:4] == ["kept"] * 4
    assert seen[-1] == "broken"


def test_a_rate_that_catches_up_is_not_off() -> None:
    world = _World(2.0)
    world.second([500, 999])
    world.second([450, 999])
    assert world.second([300, 500, 600, 700]).standing == "kept"


def test_while_no_rate_is_expected_none_is_broken_and_the_next_second_is_ignored() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    now_ns, world.now_ns = world.now_ns, None
    assert world.rate.read().standing == "kept"
    world.now_ns = now_ns
    standings = [world.second(every(20)).standing for _ in range(3)]
    assert standings == ["kept", "kept", "off"]


def test_while_simulated_time_is_paused_nothing_is_broken() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    world.rate.read()
    assert {world.rate.read().standing for _ in range(5)} == {"kept"}


def test_simulated_time_that_goes_back_restarts_the_rate() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    world.now_ns = 0
    rate = world.rate.read()
    assert (rate.standing, rate.measured_hz) == ("kept", 100.0), "no half of it is reported as kept"
    assert [world.second(every(10)).measured_hz for _ in range(2)] == pytest.approx([100.0] * 2)


def test_a_restarted_rate_ignores_ticks_before() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20), late_ns=MS)
    world.rate.restart()
    rate = world.second(every(10))
    assert (rate.ticks, rate.standing, rate.late_max_us) == (100, "kept", 0.0)


class _Listing(TickCounter):
    """Stores the lateness reports."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[int, int]] = []

    def tick(self, now_ns: int, late_ns: int, skipped: int = 0) -> None:
        self.seen.append((late_ns, skipped))
        super().tick(now_ns, late_ns, skipped)


class _Timer:
    """An rcl timer's schedule: calls skip to the next multiple of the period."""

    def __init__(self, period_ns: int) -> None:
        self.now_ns = 0
        self._period_ns = period_ns
        self._next_ns = period_ns
        self.counter = _Listing()
        self.ticks = TimerTicks(self.counter, period_ns=period_ns, clock=lambda: self.now_ns)
        self.handle = self
        self.ticks.follow(self)  # type: ignore[arg-type]

    def time_until_next_call(self) -> int:
        return self._next_ns - self.now_ns

    def call_at(self, now_ns: int) -> None:
        self.now_ns = now_ns
        self._next_ns += self._period_ns
        if self._next_ns < now_ns:
            self._next_ns += -(-(now_ns - self._next_ns) // self._period_ns) * self._period_ns
        self.ticks.tick()


def test_lateness_is_reported_by_the_timers_own_schedule() -> None:
    timer = _Timer(MS)
    for now_us in (1_000, 2_100, 3_000, 7_300, 8_000):
        timer.call_at(now_us * 1_000)
    assert timer.counter.seen == [(0, 0), (100_000, 0), (0, 0), (3_300_000, 3), (0, 0)]


def test_a_timer_that_starts_again_has_skipped_nothing() -> None:
    timer = _Timer(MS)
    timer.call_at(MS)
    timer._next_ns = 5 * S + MS
    timer.ticks.restart()
    timer.call_at(5 * S + MS)
    assert timer.counter.overruns == 0


def test_missing_samples_are_counted() -> None:
    counter = TickCounter()
    times_ns = [20 * MS, 40 * MS, 100 * MS, 0, 20 * MS]
    ticks = SampleTicks(counter, period_ns=20 * MS, clock=iter(times_ns).__next__)
    for _ in times_ns:
        ticks.tick()
    assert (counter.ticks, counter.overruns) == (5, 2)


US = 1_000
SHARES = (0.5, 0.99, 1.0)
LATE_NS = st.integers(2 * US, 60_000_000 * US)


def counted(late_ns: list[int]) -> TickCounter:
    counter = TickCounter()
    for number, late in enumerate(late_ns):
        counter.tick(number, late)
    return counter


@given(st.lists(LATE_NS, min_size=1, max_size=300))
def test_reported_percentiles_are_never_too_low_and_at_most_a_sixteenth_too_high(
    late_ns: list[int],
) -> None:
    ordered = sorted(late_ns)
    read = late_ns_of(counted(late_ns).buckets, SHARES)
    for share, found in zip(SHARES, read, strict=True):
        exact = next(x for n, x in enumerate(ordered, start=1) if n >= share * len(ordered))
        assert exact <= found <= exact * 17 / 16


def test_less_than_a_microsecond_is_nothing_and_ahead_of_time_too() -> None:
    assert late_ns_of(counted([-5, 0, 999]).buckets, SHARES) == (0.0, 0.0, 0.0)


def test_hours_of_lateness_are_counted_in_the_last_bucket() -> None:
    (longest,) = late_ns_of(counted([10**13]).buckets, (1.0,))
    assert longest > 120e9


def test_without_ticks_nothing_is_late() -> None:
    assert late_ns_of(TickCounter().buckets, SHARES) == (0.0, 0.0, 0.0)


def test_ticks_and_those_left_out_are_summed_up() -> None:
    counter = TickCounter()
    counter.tick(1_000, 0)
    counter.tick(5_000, 0, skipped=3)
    assert (counter.ticks, counter.overruns, counter.newest_ns) == (2, 3, 5_000)
