"""Goals that are met, not met, or not measured, and their reasons."""

import pytest

from benchmarks.goals import GOALS, Goal
from benchmarks.summary import goals_page


def _goal(what, **limits):
    return Goal(what=what, figure=lambda results: results[what], **limits)


def test_a_goal_is_met_not_met_or_not_measured():
    goals = {"Section": [_goal("a", most=2.0), _goal("b", least=2.0), _goal("c", most=1.0)]}
    page = list(goals_page(goals, {"a": 1.0, "b": 1.0}))
    assert page[0].startswith("# ")
    assert "| a | ≤ 2 | 1 | met |" in page
    assert "| b | ≥ 2 | 1 | **not met** |" in page
    assert "| c | ≤ 1 | | not measured |" in page


def test_a_reason_is_listed_once_below_the_table_and_only_if_needed():
    goals = {
        "Section": [
            _goal("a", most=0.0, why="first"),
            _goal("b", most=0.0, why="second"),
            _goal("c", most=0.0, why="first"),
            _goal("d", most=2.0, why="third"),
        ]
    }
    page = list(goals_page(goals, dict.fromkeys("abcd", 1.0)))
    assert [line[-4:-2] for line in page if line.startswith("| ") and "not met" in line] == [
        "1)",
        "2)",
        "1)",
    ]
    assert [line for line in page if line[:2] in ("1.", "2.", "3.")] == ["1. first", "2. second"]


@pytest.mark.parametrize("section", GOALS)
def test_every_goal_has_a_limit_and_a_section_does_not_start_with_the_same(section):
    goals = GOALS[section]
    assert all(goal.least is not None or goal.most is not None for goal in goals)
    assert not goals[0].what.startswith("the same")


def test_without_results_no_goal_is_measured():
    page = "\n".join(goals_page(GOALS, {}))
    assert page.count("not measured") == sum(map(len, GOALS.values()))
