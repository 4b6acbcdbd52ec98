"""Schedules that a seed draws."""

import pytest

from obk_testing.trial import Schedule

NODES = ("/robot", "/estimation", "/control")


def test_seed_0_has_the_ideal_schedule() -> None:
    assert Schedule.varied(0, NODES).is_ideal


@pytest.mark.parametrize("seed", range(1, 50))
def test_other_seeds_vary_phases_jitter_and_bring_up(seed: int) -> None:
    schedule = Schedule.varied(seed, NODES)
    assert schedule == Schedule.varied(seed, NODES)
    assert schedule.phases
    assert 0.0 <= schedule.jitter <= 0.0003
    assert schedule.bring_up.keys() == set(NODES)
    assert all(0.0 <= start <= 0.02 for start in schedule.bring_up.values())


def test_seeds_draw_different_schedules() -> None:
    drawn = {Schedule.varied(seed, NODES).jitter for seed in range(1, 50)}
    orders = {
        tuple(sorted(NODES, key=Schedule.varied(seed, NODES).bring_up.__getitem__))
        for seed in range(1, 50)
    }
    assert len(drawn) == 49
    assert len(orders) == 6
