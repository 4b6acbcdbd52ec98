"""What counts as growth in a soak."""

import random

from benchmarks.soak import growth, verdicts


def samples(rss_of: object) -> list[dict[str, object]]:
    """A process of a minute, sampled every 2 s."""
    return [
        {
            "time_s": 2.0 * n,
            "who": "/a",
            "pid": 7,
            "pss_mb": 50.0,
            "handles": 20,
            "sockets": 4,
            "threads": 9,
            "rss_mb": rss_of(n),  # type: ignore[operator]
        }
        for n in range(30)
    ]


def test_a_straight_line_grows_by_its_slope() -> None:
    assert round(growth([0.0, 1.0, 2.0, 3.0], [5.0, 7.0, 9.0, 11.0]), 6) == 6.0
    assert growth([0.0, 1.0], [5.0, 7.0]) == 0.0


def test_noise_and_a_warm_start_are_flat() -> None:
    draw = random.Random(1)
    found = verdicts(samples(lambda n: (60.0 if n < 6 else 80.0) + draw.uniform(-1, 1)))
    assert len(found) == 5
    assert all(one["is_flat"] for one in found)


def test_a_leak_is_not() -> None:
    found = verdicts(samples(lambda n: 80.0 + n))
    assert [one["count"] for one in found if not one["is_flat"]] == ["rss_mb"]
