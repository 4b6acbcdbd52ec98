"""The loop's figures as the project's README shows them."""

from typing import Any

import pytest

from benchmarks.loop.cases import BASELINE, LIBRARY, Case
from benchmarks.readme import BEGIN, END, peers_table, with_table


def row(contestant: str, layout: str, ratio: float, rate_hz: float) -> dict[str, Any]:
    return {
        "case": Case(contestant=contestant, layout=layout).as_dict(),
        "figures": {"rate_hz": {"median": rate_hz}},
        "ratios": {"cpu_per_tick_us": {"median": ratio}},
        "runs": 5,
    }


def test_each_contestant_has_a_line_and_who_failed_says_so() -> None:
    cases = [
        row(BASELINE, "separate", 1.0, 849.2),
        row(BASELINE, "composed", 10.3, 949.0),
        row(LIBRARY, "separate", 0.456, 998.7),
        {**row(LIBRARY, "composed", 0.2, 999.0), "runs": 0},
    ]
    lines = list(peers_table({"cases": cases}))
    assert f"| {BASELINE} | 1.00 | 849 Hz | 10 | 949 Hz |" in lines
    assert f"| {LIBRARY} | 0.46 | 999 Hz | failed |  |" in lines


def test_a_case_of_another_rate_is_not_taken_for_the_work() -> None:
    slow = row(LIBRARY, "separate", 0.1, 100.0)
    slow["case"]["rate_hz"] = 100
    assert f"| {LIBRARY} | failed |  | failed |  |" in list(peers_table({"cases": [slow]}))


def test_a_table_takes_the_place_of_the_one_before() -> None:
    document = f"# How fast\n\n{BEGIN}\n\n| old |\n\n{END}\n\nEnd.\n"
    assert with_table(document, "| new |") == document.replace("old", "new")
    with pytest.raises(ValueError, match="substring not found"):
        with_table("# How fast\n", "| new |")
