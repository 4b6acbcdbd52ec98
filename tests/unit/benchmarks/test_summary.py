"""Goals, and the table of them."""

import pytest

from benchmarks.summary import Goal, goals_table, notes, slowest_look


@pytest.mark.parametrize(
    ("least", "most", "value", "words", "is_met"),
    [
        (None, 0.33, 0.33, "≤ 0.33 s", True),
        (None, 0.33, 0.34, "≤ 0.33 s", False),
        (99.8, None, 99.7, "≥ 99.8 s", False),
        (0.8, 1.2, 1.2, "0.8 to 1.2 s", True),
        (0.8, 1.2, 0.7, "0.8 to 1.2 s", False),
    ],
)
def test_a_goal_is_met_up_to_its_limits(
    least: float | None, most: float | None, value: float, words: str, is_met: bool
) -> None:
    goal = Goal(what="it", least=least, most=most, unit=" s", figure=lambda _: value)
    assert goal.words == words
    assert goal.is_met_by(value) is is_met


def test_the_table_holds_each_figure_against_its_goal() -> None:
    goals = (
        Goal(what="start", most=1.5, unit=" s", figure=lambda results: float(results["up"])),
        Goal(what="rate", least=99.8, unit=" %", figure=lambda results: float(results["rate"])),
        Goal(what="lateness", most=300, unit=" µs", figure=lambda _: 20971.5),
    )
    assert list(goals_table(goals, {"up": 1.8312, "rate": 99.9}))[2:] == [
        "| start | ≤ 1.5 s | 1.83 s | **not met** |",
        "| rate | ≥ 99.8 % | 99.9 % | met |",
        "| lateness | ≤ 300 µs | 20972 µs | **not met** |",
    ]


def test_what_was_not_measured_has_a_row_all_the_same() -> None:
    goal = Goal(what="start", most=1.5, figure=lambda results: float(results["up"]))
    assert list(goals_table([goal], {}))[2:] == ["| start | ≤ 1.5 | | not measured |"]


def test_results_that_the_host_had_a_part_in_are_named() -> None:
    results = {
        "launches": {"stolen_percent": 1.0},
        "watched": {"runs": {"separate": [{"stolen_percent": 2.0}, {"stolen_percent": 9.4}]}},
        "loop": {"is_quiet": False, "cases": [{"stolen_percent": {"median": 50.0}}]},
    }
    assert list(notes(results)) == [
        "loop: the machine was not quiet before every round",
        "watched: up to 9 % of a core was stolen by the machine's host",
    ]


def test_the_time_that_a_command_is_told_to_measure_for_is_not_its_own() -> None:
    commands = {"topic list": 0.25, "topic hz est --duration 0.5": 0.8, "lifecycle get": 2.0}
    took = {words: {"median_s": seconds} for words, seconds in commands.items()}
    assert slowest_look(took) == pytest.approx(0.25)
    assert slowest_look(took, has_messages=True) == pytest.approx(0.3)
