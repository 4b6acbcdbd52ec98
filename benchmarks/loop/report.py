"""Write the results of a suite: `loop.json` with everything, `loop.md` with a table to read."""

import json
import math
import os
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.loop.cases import CONTESTANTS, CURVE, FLOOR, LAYOUTS, WORK, Case
from benchmarks.loop.figures import Figures, Spread, ratios, spread, spreads
from benchmarks.loop.suite import Suite
from benchmarks.loop.turns import Failed, Run
from benchmarks.stolen import DISTURBED_PERCENT
from obk_cli.optional_deps import run_versions

__all__ = ["Row", "machine", "rows_of", "table", "write_json", "write_table"]

IN_RATIO = ("cpu_percent", "cpu_per_tick_us", "late_p99_us", "latency_p99_ms")
QUIET_PERCENT = 10.0
"""Use of all cores above which the machine was busy before a round; the results then say so."""
DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The results of a case over all rounds."""

    case: Case
    figures: Mapping[str, Spread]
    """Empty if no run succeeded."""
    ratios: Mapping[str, Spread]
    """Relative to the baseline in the same round, for measures where lower is better."""
    runs: int
    """The number of successful runs."""
    failures: tuple[str, ...]


def rows_of(suite: Suite) -> tuple[Row, ...]:
    """One row per case, in the order of their first runs."""
    runs: dict[Case, list[Run]] = {}
    for run in suite.runs:
        runs.setdefault(run.case, []).append(run)
    measured = {case: _figures(found) for case, found in runs.items()}
    return tuple(
        Row(
            case=case,
            figures=spreads(list(measured[case].values())) if measured[case] else {},
            ratios={
                name: found
                for name in IN_RATIO
                if (found := ratios(measured[case], measured.get(case.baseline, {}), name))
            },
            runs=len(measured[case]),
            failures=tuple(r.outcome.why for r in runs[case] if isinstance(r.outcome, Failed)),
        )
        for case in runs
    )


def write_json(path: Path, suite: Suite) -> None:
    """Write all results, including the machine and its load."""
    found = _stolen_percents(suite)
    content = {
        "machine": machine(),
        "versions": dict(run_versions()),
        "is_quiet": _is_quiet(suite),
        "stolen_percent": spread(found).median if found else 0.0,
        "runs_disturbed": suite.disturbed,
        "runs_disturbed_and_kept": suite.disturbed_and_kept,
        "before_each_round": [asdict(load) for load in suite.loads],
        "seconds_of_each_run": {"work": WORK.seconds, "curves": CURVE.seconds},
        "cases": [{**asdict(row), "case": row.case.as_dict()} for row in rows_of(suite)],
    }
    path.write_text(json.dumps(_rounded(content), indent=1) + "\n", encoding="utf-8")


def write_table(path: Path, suite: Suite) -> None:
    """Write the table of the `work` part as Markdown."""
    lines = [
        "# The loop",
        "",
        "sim -> est -> ctrl -> sim: three nodes, 30 joints, a 1 kHz timer in each node. Values are",
        "medians (minimum to maximum) of all rounds; ratios are relative to rclpy's",
        "SingleThreadedExecutor in the same round.",
        "",
        *(f"- {name}: {value}" for name, value in machine().items()),
        f"- versions: {', '.join(f'{name} {it}' for name, it in run_versions().items())}",
        *(f"- {line}" for line in disturbances(suite)),
    ]
    if not _is_quiet(suite):
        lines += [
            "",
            "**The machine was busy with other load, or its host stole time: these results prove "
            "nothing.**",
        ]
    path.write_text("\n".join([*lines, "", *table(rows_of(suite)), ""]), encoding="utf-8")


def disturbances(suite: Suite) -> list[str]:
    """What disturbed the measurements, one sentence per line."""
    loads = suite.loads
    lines = [
        f"before a round, measured {len(loads)} times: "
        f"busy {_range([load.busy_percent for load in loads])} %; "
        f"p99 lateness of a bare 1 kHz timer "
        f"{_range([load.bare_late_p99_us for load in loads])} us, with "
        f"{_range([load.bare_stolen_percent for load in loads])} % of a core stolen"
    ]
    if found := _stolen_percents(suite):
        of_floor = [
            run.outcome.stolen_percent
            for run in suite.runs
            if isinstance(run.outcome, Figures) and run.case.contestant == FLOOR
        ]
        floor = f", from {FLOOR} {_range(of_floor)} %" if of_floor else ""
        lines.append(
            f"stolen by the host during runs: {_range(found)} % of a core{floor}; part of it is "
            "caused by the contestant's own wake-ups"
        )
    reported = (
        f"in {suite.disturbed or 'no'} runs, {DISTURBED_PERCENT:g} % of a core more was stolen "
        "than in the quietest run of the same case"
    )
    if suite.disturbed:
        kept = suite.disturbed_and_kept
        reported += f"; {kept} of them count, because further rounds were no better"
    return [*lines, reported]


def table(rows: Iterable[Row]) -> list[str]:
    """The lines of a Markdown table with the cases of the `work` part."""
    found = {row.case: row for row in rows}
    lines = [
        "| | CPU [% of a core] | ratio | CPU per tick [us] | lateness p50 [us] | p99 [us] | ratio "
        "| slowest node [Hz] | latency p50 [ms] | p99 [ms] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for layout in LAYOUTS:
        for contestant in CONTESTANTS:
            row = found.get(Case(contestant=contestant, layout=layout))
            if row is not None:
                lines.append(f"| {contestant}, {layout} | {' | '.join(_cells(row))} |")
    return lines


def _cells(row: Row) -> list[str]:
    if not row.figures:
        return [f"failed: {row.failures[0]}", *[""] * 8]
    cpu, late, rate = (row.figures[n] for n in ("cpu_percent", "late_p99_us", "rate_hz"))
    return [
        _cell(cpu),
        _cell(row.ratios.get("cpu_percent")),
        _cell(row.figures["cpu_per_tick_us"]),
        _cell(row.figures["late_p50_us"]),
        _cell(late),
        _cell(row.ratios.get("late_p99_us")),
        _cell(rate),
        _cell(row.figures["latency_p50_ms"]),
        _cell(row.figures["latency_p99_ms"]),
    ]


def _cell(value: Spread | None) -> str:
    if value is None:
        return ""
    if value.min == value.max:
        return _short(value.median)
    return f"{_short(value.median)} ({_short(value.min)} to {_short(value.max)})"


def _short(value: float) -> str:
    """Format with three significant digits."""
    if value == 0:
        return "0"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"


def _figures(runs: Iterable[Run]) -> dict[int, Figures]:
    return {run.round: run.outcome for run in runs if isinstance(run.outcome, Figures)}


def _is_quiet(suite: Suite) -> bool:
    """Whether the machine was idle before all rounds, and hardly disturbed before most of them."""
    stolen = [load.bare_stolen_percent for load in suite.loads]
    is_idle = all(load.busy_percent < QUIET_PERCENT for load in suite.loads)
    return is_idle and (not stolen or spread(stolen).median < DISTURBED_PERCENT)


def _stolen_percents(suite: Suite) -> list[float]:
    outcomes = (run.outcome for run in suite.runs)
    return [outcome.stolen_percent for outcome in outcomes if isinstance(outcome, Figures)]


def _range(values: list[float]) -> str:
    return _cell(spread(values)) if values else "unknown"


def machine() -> dict[str, Any]:
    """Describe the machine."""
    cpuinfo = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = (line.partition(":")[2].strip() for line in cpuinfo if line.startswith("model name"))
    return {
        "processor": next(models, platform.machine()),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def _rounded(value: Any) -> Any:
    """Round all numbers to a few significant digits."""
    if isinstance(value, Mapping):
        return {name: _rounded(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
