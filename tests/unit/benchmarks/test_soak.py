"""The plan of a soak, and its verdicts on growth and rates."""

import random
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from benchmarks.bare_timer import BareSecond
from benchmarks.soak.__main__ import verdict
from benchmarks.soak.counts import growth, verdicts
from benchmarks.soak.plan import DECK, first_deck, plan
from benchmarks.soak.rates import Rates, is_void
from benchmarks.soak.results import draw_picture
from benchmarks.soak.stack import Stack


def samples(rss_of: Any, count: int = 60) -> list[dict[str, Any]]:
    """Samples of a process every 2 s, for two minutes."""
    return [
        {
            "time_s": 2.0 * n,
            "who": "/a",
            "pid": 7,
            "pss_mb": 50.0,
            "handles": 20,
            "sockets": 4,
            "threads": 9,
            "rss_mb": rss_of(n),
        }
        for n in range(count)
    ]


def second(kept: float = 1.0, stolen_percent: float = 0.0, idle_percent: float = 50.0) -> Any:
    return BareSecond(
        at_s=1.0,
        kept=kept,
        late_p99_us=70.0,
        stolen_percent=stolen_percent,
        idle_percent=idle_percent,
    )


def node(standing: str) -> dict[str, Any]:
    rate = {"name": "timer", "standing": standing, "measured_hz": 900.0, "expected_hz": 1000.0}
    return {"node": "/a", "rates": [rate]}


def test_the_first_deck_has_every_fault_and_ends_without_observers() -> None:
    deck = first_deck(random.Random(3))
    assert Counter(deck) == Counter({*DECK, "reload"})
    assert deck[-1] == "observers_leave"
    assert "freeze" not in first_deck(random.Random(3), is_frozen=False)


def test_the_same_seed_gives_the_same_plan_and_the_config_is_changed_rarely() -> None:
    first, second = (list(islice(plan(random.Random(3)), 200)) for _ in range(2))
    assert first == second
    assert 1 < first.count("reload") < 6
    assert set(first[50:]) >= set(DECK)


def test_a_straight_line_grows_by_its_slope_without_noise() -> None:
    found = growth([0.0, 1.0, 2.0, 3.0], [5.0, 7.0, 9.0, 11.0])
    assert (round(found.grown, 6), round(found.noise, 6)) == (6.0, 0.0)
    assert growth([0.0, 1.0], [5.0, 7.0]).grown == 0.0


def test_noise_is_the_standard_error_of_growth() -> None:
    # Residuals 0.2, -0.6, 0.6, -0.2 of a line with slope -0.2: sqrt(0.8 / 2 / 5) over 3 s.
    found = growth([0.0, 1.0, 2.0, 3.0], [1.0, 0.0, 1.0, 0.0])
    assert (found.grown, found.noise) == (pytest.approx(-0.6), pytest.approx(0.08**0.5 * 3))


def test_noise_and_a_warm_start_are_flat() -> None:
    draw = random.Random(1)
    found = verdicts(samples(lambda n: (60.0 if n < 12 else 80.0) + draw.uniform(-1, 1)))
    assert len(found) == 5
    assert all(one["is_flat"] for one in found)


def test_a_leak_is_not_flat() -> None:
    found = verdicts(samples(lambda n: 80.0 + n))
    assert [one["count"] for one in found if not one["is_flat"]] == ["rss_mb"]


@pytest.mark.parametrize(("least_mb", "is_flat"), [(3.0, False), (10.0, True)])
def test_in_a_short_run_more_memory_is_allowed(least_mb: float, is_flat: bool) -> None:
    found = verdicts(samples(lambda n: 80.0 + 0.15 * n), least_mb=least_mb)
    assert next(one for one in found if one["count"] == "rss_mb")["is_flat"] is is_flat


def test_a_short_lived_process_is_not_judged() -> None:
    assert not verdicts(samples(lambda n: 80.0 + n, count=40))


def test_more_and_more_files_in_shared_memory_are_growth() -> None:
    shared = [
        {"time_s": 2.0 * n, "who": "shared memory", "pid": 0, "shm_files": n} for n in range(60)
    ]
    ((count, is_flat),) = [(one["count"], one["is_flat"]) for one in verdicts(shared)]
    assert (count, is_flat) == ("shm_files", False)


@pytest.mark.parametrize(
    ("seconds", "void"),
    [
        ([], True),
        ([second()], False),
        ([second(), second(kept=0.98)], True),
        ([second(stolen_percent=8.0), second()], True),
        ([second(idle_percent=3.0)], True),
    ],
)
def test_a_second_in_which_the_machine_cannot_keep_a_rate_is_void(
    seconds: list[BareSecond], void: bool
) -> None:
    assert is_void(seconds) is void


def test_a_broken_rate_is_a_fault_unless_its_second_is_void() -> None:
    rates = Rates()
    rates.look([node("broken")], [second(kept=0.5)], 3.0)
    rates.look([node("off")], [second()], 5.0)
    assert (rates.judged, rates.void, rates.faults) == (1, 1, [])
    rates.look([node("broken")], [second()], 7.0)
    assert rates.faults == ["7 s: /a timer: 900 of 1000 Hz"]


def test_the_verdict_mentions_that_rates_were_never_judged() -> None:
    assert verdict(True, Rates(judged=1, void=9)) == "sound"
    assert verdict(True, Rates(void=9)) == "sound; rates were not judged"
    assert verdict(False, Rates(judged=1)) == "NOT sound"


def test_a_config_is_changed_and_changed_back(tmp_path: Path) -> None:
    folder = tmp_path / "example"
    folder.mkdir()
    example = folder / "dummy.yaml"
    text = "a:\n  timer_period_sec: 0.1\nb:\n  timer_period_sec: 0.1\n"
    example.write_text(text)
    stack = Stack.of(example, tmp_path / "home", ())
    assert stack.change_period() == 5.0
    assert stack.config.read_text() == text.replace("0.1", "0.2", 1)
    assert stack.change_period() == 10.0
    assert stack.config.read_text() == text
    assert example.read_text() == text


def test_a_traceback_is_found_and_a_warning_is_ignored(tmp_path: Path) -> None:
    stack = Stack(home=tmp_path, config=tmp_path / "dummy.yaml")
    assert stack.tracebacks() == []
    (tmp_path / "stderr.log").write_text(
        "warning: x\nTraceback (most recent call last):\n"
        '  File "a.py", line 1, in <module>\n    f()\nKeyError: 1\nbye\n'
    )
    assert stack.tracebacks() == ["KeyError: 1"]


def test_the_same_samples_give_the_same_plot(tmp_path: Path) -> None:
    shared = {"time_s": 0.0, "who": "shared memory", "pid": 0, "shm_files": 4}
    result = {
        "samples": [*samples(lambda n: 80.0, 3), shared],
        "troubles": [{"time_s": 2.0, "trouble": "kill"}],
    }
    first, second = tmp_path / "first.svg", tmp_path / "second.svg"
    draw_picture(result, first)
    draw_picture(result, second)
    assert first.read_bytes() == second.read_bytes()
    assert b"rss mb" in first.read_bytes()
