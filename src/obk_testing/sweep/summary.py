"""Summarize a sweep: pass rates, worst cases and distributions, as text and JSON."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from obelisk_spec.suggestions import with_number
from obk_testing.summary import rerun_command
from obk_testing.sweep.cases import Outcome, Row, SweepCase

__all__ = ["PassRate", "Result", "Summary", "duration_text", "summary_json", "summary_text"]

_PARTS: Final = 10
_MOST_SHOWN: Final = 5
_MOST_WORST: Final = 20
_BAD: Final[tuple[Outcome, ...]] = ("died", "failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A finished case."""

    case: SweepCase
    row: Row

    @property
    def title(self) -> str:
        """What distinguishes the case from others of its test."""
        seed = () if self.case.seed is None else (f"seed {self.case.seed}",)
        return ", ".join((*seed, *self.case.settings)) or "the only case"


@dataclass(frozen=True, slots=True, kw_only=True)
class PassRate:
    """The results for one value of a parameter, or for a part of its range."""

    label: str
    low: float | None
    """Lower end of the part; None for a single value."""
    high: float | None
    passed: int
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The state of a sweep."""

    name: str
    config: str
    """Path as given by the user."""
    results: tuple[Result, ...]
    """Results in the order of cases."""
    count: int
    """Number of cases in the sweep."""
    varied: tuple[str, ...]
    """Paths in the config."""
    notes: tuple[str, ...]
    machine: Mapping[str, str]
    engine: str

    @property
    def outcomes(self) -> Mapping[Outcome, int]:
        """Number of cases per outcome."""
        return Counter(result.row.outcome for result in self.results)

    @property
    def bad(self) -> tuple[Result, ...]:
        """The cases that could not be run, then those that failed."""
        return tuple(
            result for kind in _BAD for result in self.results if result.row.outcome == kind
        )

    @property
    def all_passed(self) -> bool:
        """Whether every case has finished and none is bad."""
        return len(self.results) == self.count and not self.bad

    @property
    def tests(self) -> Mapping[str, tuple[Result, ...]]:
        """The results of each test."""
        grouped: dict[str, list[Result]] = defaultdict(list)
        for result in self.results:
            grouped[result.case.test].append(result)
        return {name: tuple(results) for name, results in grouped.items()}

    def metrics(self, test: str) -> Mapping[str, tuple[tuple[Result, float], ...]]:
        """Return the numbers that a test recorded, also NaN: name -> pairs of case and value."""
        found: dict[str, list[tuple[Result, float]]] = defaultdict(list)
        for result in self.tests[test]:
            for name, value in result.row.metrics.items():
                if isinstance(value, int | float):
                    found[name].append((result, float(value)))
        return {name: tuple(values) for name, values in found.items()}

    def worst(self) -> tuple[tuple[Result, str], ...]:
        """Return the worst cases, each with why it is listed.

        Of each metric, the first case with NaN or an infinite value, then bad cases, then those
        with an extreme of a metric.
        """
        found: dict[str, tuple[Result, str]] = {}
        extremes: dict[str, tuple[Result, str]] = {}
        for test in self.tests:
            for name, values in self.metrics(test).items():
                odd = [(result, value) for result, value in values if not math.isfinite(value)]
                for result, value in odd[:1]:
                    count = with_number(len(odd), "case")
                    why = f"`{name}` is {value}; NaN or infinite in {count}"
                    outcome = f"{result.row.outcome}, " if result.row.is_bad else ""
                    found.setdefault(result.case.key, (result, outcome + why))
                finite = [pair for pair in values if math.isfinite(pair[1])]
                for end, word in ((max, "largest"), (min, "smallest")) if finite else ():
                    result = end(finite, key=_value)[0]
                    extremes.setdefault(result.case.key, (result, f"{word} `{name}`"))
        bad = {one.case.key: (one, str(one.row.outcome)) for one in self.bad[:_MOST_WORST]}
        for others in (bad, extremes):
            for key, entry in others.items():
                found.setdefault(key, entry)
        return tuple(found.values())[:_MOST_WORST]

    def rerun_command(self, case: SweepCase) -> str:
        """Return the command that repeats a case."""
        return rerun_command(self.config, case.settings, case.node_id)

    def parts(self, test: str, path: str) -> tuple[PassRate, ...]:
        """Return the pass rates of a test over the values of a parameter."""
        results = self.tests[test]
        texts = [dict(result.case.overrides)[path] for result in results]
        listed = tuple(dict.fromkeys(texts))
        try:
            numbers = [float(text) for text in texts]
        except ValueError:
            numbers = []
        if not numbers or len(listed) <= _PARTS:
            ordered = sorted(listed, key=float) if numbers else listed
            return tuple(
                _part(
                    value,
                    None,
                    None,
                    [r for r, t in zip(results, texts, strict=True) if t == value],
                )
                for value in ordered
            )
        return tuple(_parts_of_range(results, numbers))


def _value(pair: tuple[Result, float]) -> float:
    return pair[1]


def _parts_of_range(results: Sequence[Result], numbers: Sequence[float]) -> Iterator[PassRate]:
    low, high = min(numbers), max(numbers)
    width = (high - low) / _PARTS
    grouped: list[list[Result]] = [[] for _ in range(_PARTS)]
    for result, number in zip(results, numbers, strict=True):
        grouped[min(int((number - low) / width), _PARTS - 1)].append(result)
    for place, group in enumerate(grouped):
        start, end = low + place * width, low + (place + 1) * width
        yield _part(f"{start:.4g} to {end:.4g}", start, end, group)


def _part(label: str, low: float | None, high: float | None, group: Sequence[Result]) -> PassRate:
    counted = [result for result in group if result.row.outcome != "skipped"]
    passed = sum(result.row.outcome == "passed" for result in counted)
    return PassRate(label=label, low=low, high=high, passed=passed, count=len(counted))


def duration_text(seconds: float) -> str:
    """Format a duration, `5 min 12 s`."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def summary_text(summary: Summary, report: str) -> str:
    """Format the summary for a terminal."""
    lines: list[str] = []
    for test, results in summary.tests.items():
        counted = [result for result in results if result.row.outcome != "skipped"]
        passed = sum(result.row.outcome == "passed" for result in results)
        skipped = len(results) - len(counted)
        left_out = f", {skipped} skipped" if skipped else ""
        lines.append(f"{test}: {passed} of {len(counted)} passed{left_out}")
        if passed < len(counted):
            for path in summary.varied:
                lines += _parts_text(path, summary.parts(test, path))
    for result in summary.bad[:_MOST_SHOWN]:
        lines += ["", f"{result.case.test}, {result.title}", f"  {result.row.why}"]
        lines.append(f"  again: {summary.rerun_command(result.case)}")
    if len(summary.bad) > _MOST_SHOWN:
        lines += ["", f"{len(summary.bad) - _MOST_SHOWN} more are in the report"]
    lines += [f"note: {note}" for note in summary.notes]
    done = len(summary.results)
    count = with_number(summary.count, "case")
    lines += ["", count if done == summary.count else f"{done} of {count}"]
    lines[-1] += f", {len(summary.bad)} failed" if summary.bad else ", all passed"
    lines.append(f"report: {report}")
    return "\n".join(lines)


def _parts_text(path: str, parts: Sequence[PassRate]) -> Iterator[str]:
    width = max(len(part.label) for part in parts)
    for number, part in enumerate(parts):
        name = path if number == 0 else " " * len(path)
        yield f"  {name}  {part.label:<{width}}  {part.passed} of {part.count}"


def summary_json(summary: Summary, report: str, database: str) -> dict[str, Any]:
    """Return the summary for programs."""
    return {
        "ok": summary.all_passed,
        "config": summary.config,
        "cases": summary.count,
        "done": len(summary.results),
        "outcomes": dict(summary.outcomes),
        "tests": [
            {
                "test": test,
                "cases": len(results),
                "passed": sum(result.row.outcome == "passed" for result in results),
                "parameters": {
                    path: [
                        {"values": part.label, "passed": part.passed, "cases": part.count}
                        for part in summary.parts(test, path)
                    ]
                    for path in summary.varied
                },
            }
            for test, results in summary.tests.items()
        ],
        "failed": [
            {
                "test": result.case.test,
                "seed": result.case.seed,
                "set": dict(result.case.overrides),
                "outcome": result.row.outcome,
                "why": result.row.why,
                "metrics": dict(result.row.metrics),
                "digest": result.row.digest,
                "again": summary.rerun_command(result.case),
            }
            for result in summary.bad
        ],
        "notes": list(summary.notes),
        "machine": dict(summary.machine),
        "report": report,
        "database": database,
    }
