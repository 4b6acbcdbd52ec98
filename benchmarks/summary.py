"""Compare the latest results with their goals.

    python -m benchmarks.summary

Reads all existing `benchmarks/results/*.json` and writes `goals.md` next to them. Also updates the
table in the project's README that compares the loop with rclpy's executors.
"""

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from benchmarks.goals import GOALS, Goal, Results
from benchmarks.readme import peers_table, with_table
from benchmarks.stolen import DISTURBED_PERCENT

__all__ = ["goals_page", "goals_table", "main", "notes"]

ROOT: Final = Path(__file__).resolve().parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results"
README: Final = ROOT / "README.md"


def goals_page(goals: Mapping[str, Iterable[Goal]], results: Results) -> Iterator[str]:
    """The lines of a Markdown document: a table per section, and the notes."""
    yield "# The newest results, compared with their goals"
    for section, its_goals in goals.items():
        yield from ("", f"## {section}", "", *goals_table(its_goals, results))
    if reported := [f"- {note}" for note in notes(results)]:
        yield from ("", "## What disturbed the measurements", "", *reported)


def goals_table(goals: Iterable[Goal], results: Results) -> Iterator[str]:
    """The lines of a Markdown table, followed by the reasons why goals are not met."""
    yield "| | goal | measured | |"
    yield "|---|---|---|---|"
    reasons: list[str] = []
    for goal in goals:
        try:
            value = goal.figure(results)
        except KeyError:
            yield f"| {goal.what} | {goal.limits} | | not measured |"
            continue
        met = "met" if goal.is_met_by(value) else f"**not met**{_reference(goal.why, reasons)}"
        yield f"| {goal.what} | {goal.limits} | {_three_digits(value)}{goal.unit} | {met} |"

    if reasons:
        yield ""
        yield from (f"{number}. {reason}" for number, reason in enumerate(reasons, 1))


def _reference(reason: str, reasons: list[str]) -> str:
    """The number of a reason below the table, ` (1)`; adds the reason if it is new."""
    if not reason:
        return ""
    if reason not in reasons:
        reasons.append(reason)
    return f" ({reasons.index(reason) + 1})"


def _three_digits(value: float) -> str:
    """Format with at least three significant digits, and without an exponent."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def notes(results: Results) -> Iterator[str]:
    """Name the results that the machine's host or other load disturbed."""
    for name, found in sorted(results.items()):
        if (stolen := _stolen_percent(found)) > DISTURBED_PERCENT:
            yield f"{name}: the machine's host stole up to {stolen:.0f} % of a core"
        if isinstance(found, dict) and found.get("is_quiet") is False:
            yield f"{name}: the machine was not idle before every round"


def _stolen_percent(found: Any) -> float:
    """The highest value anywhere in a result [% of a core]."""
    if isinstance(found, list):
        return max(map(_stolen_percent, found), default=0.0)
    if not isinstance(found, dict):
        return 0.0
    own = found.get("stolen_percent", 0.0)
    inner = max(map(_stolen_percent, found.values()), default=0.0)
    return max(inner, own if isinstance(own, int | float) else 0.0)


def read_results() -> Results:
    """All results, by file name without the extension."""
    return {
        path.stem: json.loads(path.read_text(encoding="utf-8")) for path in RESULTS.glob("*.json")
    }


def main() -> int:
    """Write both tables."""
    results = read_results()
    text = "\n".join(goals_page(GOALS, results))
    (RESULTS / "goals.md").write_text(f"{text}\n", encoding="utf-8")
    if "loop" in results:
        peers = "\n".join(peers_table(results["loop"]))
        document = with_table(README.read_text(encoding="utf-8"), peers)
        README.write_text(document, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
