"""Early wake-ups on a simulated clock: not before the timer is due, and short loops on average."""

import itertools
from random import Random

import pytest

from obelisk_py.core.executor import early_wakeup
from obelisk_py.core.executor.early_wakeup import EarlyWakeup

PERIOD_NS = 1_000_000


class SimulatedClock:
    """Advances by 100 ns with each reading."""

    def __init__(self) -> None:
        self.now_ns = 0

    def monotonic_ns(self) -> int:
        self.now_ns += 100
        return self.now_ns


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimulatedClock:
    clock = SimulatedClock()
    monkeypatch.setattr(early_wakeup, "time", clock)
    return clock


def lateness_ns(
    clock: SimulatedClock, wakeup: EarlyWakeup, delays_ns: list[int], period_ns: int = PERIOD_NS
) -> tuple[list[int], list[int]]:
    """Let a kernel timer wake the thread after each delay: lateness and duration of each loop."""
    late, loops = [], []
    for number, delay_ns in enumerate(delays_ns, start=1):
        due_ns = number * period_ns
        clock.now_ns = woken_ns = due_ns - wakeup.lead_ns + delay_ns
        wakeup.wait(due_ns - woken_ns, due_ns - period_ns // 2)
        late.append(clock.now_ns - due_ns)
        loops.append(max(0, due_ns - woken_ns))
        if wakeup.is_outdated:
            wakeup.renew(period_ns)
    return late, loops


def test_callbacks_become_punctual_at_the_cost_of_short_loops(clock: SimulatedClock) -> None:
    random = Random(1)
    delays_ns = [round(random.triangular(20_000, 50_000, 25_000)) for _ in range(4000)]
    wakeup = EarlyWakeup()
    wakeup.renew(PERIOD_NS)
    late, loops = lateness_ns(clock, wakeup, delays_ns)
    first, settled = late[:5], sorted(late[2000:])
    assert min(first) > 10_000
    assert settled[0] >= 0
    assert settled[len(settled) // 2] < 3_000
    assert sum(loops[2000:]) / len(loops[2000:]) < 9_000


def test_on_a_busy_machine_the_loops_remain_short(clock: SimulatedClock) -> None:
    random = Random(1)
    delays_ns = [random.choice([1_000, 900_000]) for _ in range(4000)]
    wakeup = EarlyWakeup()
    wakeup.renew(PERIOD_NS)
    _, loops = lateness_ns(clock, wakeup, delays_ns)
    assert sum(loops[1000:]) / len(loops[1000:]) < 14_000


@pytest.mark.parametrize(("period_ns", "longest_ns"), [(PERIOD_NS, 100_000), (200_000, 20_000)])
def test_the_lead_is_limited(clock: SimulatedClock, period_ns: int, longest_ns: int) -> None:
    wakeup = EarlyWakeup()
    wakeup.renew(period_ns)
    late, _ = lateness_ns(clock, wakeup, [2_000_000] * 4000, period_ns)
    assert all(late)
    assert longest_ns - 4_000 <= wakeup.lead_ns <= longest_ns


def test_a_timer_without_a_period_has_no_lead(clock: SimulatedClock) -> None:
    wakeup = EarlyWakeup()
    wakeup.renew(PERIOD_NS)
    lateness_ns(clock, wakeup, list(itertools.repeat(100_000, 500)))
    assert wakeup.lead_ns > 0
    assert wakeup.renew(0) == 0


def test_a_thread_that_was_running_when_the_timer_expired_does_not_change_the_lead(
    clock: SimulatedClock,
) -> None:
    wakeup = EarlyWakeup()
    wakeup.renew(PERIOD_NS)
    for due_ns in range(PERIOD_NS, 100 * PERIOD_NS, PERIOD_NS):
        clock.now_ns = due_ns + 20_000
        wakeup.wait(-20_000, due_ns + 10_000)
        assert not wakeup.is_outdated
