"""A promise read once a second, with ticks and a clock that the test moves."""

from collections.abc import Iterable

import pytest

from obelisk_py.core.rates.counter import TickCounter
from obelisk_py.core.rates.promise import Promise
from obelisk_py.core.rates.ticks import SampleTicks, TimerTicks
from obelisk_spec.runtime_protocol import Rate

S = 1_000_000_000
MS = 1_000_000


class _World:
    """A clock, a counter, a promise; the ticks of a second come before it is read."""

    def __init__(self, wanted_hz: float) -> None:
        self.now_ns: int | None = 10 * S
        self.steady_s = 3.0
        self.counter = TickCounter()
        self.promise = Promise(
            name="timer_ctrl",
            wanted_hz=wanted_hz,
            counter=self.counter,
            clock=lambda: self.now_ns,
            steady_s=lambda: self.steady_s,
        )

    def second(self, ticks_ms: Iterable[float] = (), late_ns: int = 0) -> Rate:
        """A second with ticks at these times from its beginning [ms]."""
        return self.after(1.0, ticks_ms, late_ns)

    def after(self, seconds: float, ticks_ms: Iterable[float] = (), late_ns: int = 0) -> Rate:
        """The promise read after another time than a second."""
        assert self.now_ns is not None
        for tick_ms in ticks_ms:
            self.counter.tick(self.now_ns + round(tick_ms * MS), late_ns)
        self.now_ns += round(seconds * S)
        self.steady_s += seconds
        return self.promise.read()


def every(period_ms: float, first_ms: float | None = None) -> list[float]:
    """The times of a second's ticks [ms]."""
    first = period_ms if first_ms is None else first_ms
    count = int((1000 - first) / period_ms) + 1
    return [first + n * period_ms for n in range(count)]


def test_a_timer_on_its_schedule_keeps_its_promise() -> None:
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
def test_what_is_broken_was_off_for_two_seconds_however_the_reads_come(
    reads_s: tuple[float, ...], standings: list[str]
) -> None:
    world = _World(100.0)
    world.second(every(10))
    assert [world.after(read_s).standing for read_s in reads_s] == standings


def test_one_good_second_is_enough_to_keep_a_promise_again() -> None:
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
    """A timer of 3 Hz has now three and now four ticks in a second."""
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


def test_what_catches_up_is_not_off() -> None:
    world = _World(2.0)
    world.second([500, 999])
    world.second([450, 999])
    assert world.second([300, 500, 600, 700]).standing == "kept"


def test_while_nothing_is_promised_nothing_is_broken_and_a_second_after_it_is_forgiven() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    now_ns, world.now_ns = world.now_ns, None
    assert world.promise.read().standing == "kept"
    world.now_ns = now_ns
    standings = [world.second(every(20)).standing for _ in range(3)]
    assert standings == ["kept", "kept", "off"]


def test_while_simulated_time_stands_still_nothing_is_broken() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    world.promise.read()
    assert {world.promise.read().standing for _ in range(5)} == {"kept"}


def test_simulated_time_that_goes_back_begins_the_promise_anew() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20))
    world.now_ns = 0
    rate = world.promise.read()
    assert (rate.standing, rate.measured_hz) == ("kept", 100.0), "no half of it is told as kept"
    assert [world.second(every(10)).measured_hz for _ in range(2)] == pytest.approx([100.0] * 2)


def test_a_promise_begun_again_knows_nothing_of_before() -> None:
    world = _World(100.0)
    for _ in range(3):
        world.second(every(20), late_ns=MS)
    world.promise.begin()
    rate = world.second(every(10))
    assert (rate.ticks, rate.standing, rate.late_max_us) == (100, "kept", 0.0)


class _Listing(TickCounter):
    """Keeps what it is told of lateness."""

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


def test_lateness_is_told_by_the_timers_own_schedule() -> None:
    timer = _Timer(MS)
    for now_us in (1_000, 2_100, 3_000, 7_300, 8_000):
        timer.call_at(now_us * 1_000)
    assert timer.counter.seen == [(0, 0), (100_000, 0), (0, 0), (3_300_000, 3), (0, 0)]


def test_a_timer_that_starts_anew_has_skipped_nothing() -> None:
    timer = _Timer(MS)
    timer.call_at(MS)
    timer._next_ns = 5 * S + MS
    timer.ticks.begin()
    timer.call_at(5 * S + MS)
    assert timer.counter.overruns == 0


def test_samples_that_do_not_come_are_counted() -> None:
    counter = TickCounter()
    times_ns = [20 * MS, 40 * MS, 100 * MS, 0, 20 * MS]
    ticks = SampleTicks(counter, period_ns=20 * MS, clock=iter(times_ns).__next__)
    for _ in times_ns:
        ticks.tick()
    assert (counter.ticks, counter.overruns) == (5, 2)
