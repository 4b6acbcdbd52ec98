"""Compare the cost and the timing accuracy of a control loop on several executors.

    python -m benchmarks.loop [--quick] [--parts PART...] [--rounds N] [--seconds S] [--go-on]

Three nodes in a ring (simulator, estimator, controller), each with a timer, a publisher and a
subscription; with one process per node, and all in one process. Parts: `work` at 1 kHz with 30
joints, and curves over the number of nodes, the rate and the message size. It writes `loop.json`,
`loop.md` and `loop_<part>.svg`. A contestant that fails is a valid result; exit code 1 if all fail.

Every run is saved in build/benchmarks/loop.jsonl. Parts measured separately are merged; --go-on
runs only what is missing, to complete an interrupted suite.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from benchmarks.loop.cases import (
    CONTESTANTS,
    LAYOUTS,
    PARTS,
    Case,
    Effort,
    cases_of,
    effort_of,
)
from benchmarks.loop.figures import Figures
from benchmarks.loop.floor import build_floor
from benchmarks.loop.journal import append_record, read_journal, write_journal
from benchmarks.loop.plots import CURVES, draw_curve
from benchmarks.loop.report import (
    disturbances,
    machine,
    rows_of,
    table,
    write_json,
    write_table,
)
from benchmarks.loop.suite import Record, estimate_s, run_suite, suite_of
from benchmarks.loop.turns import Run, turns_of
from obk_cli.optional_deps import run_versions
from obk_cli.ros.domains import free_domain
from obk_interfaces.errors import BuildToolError

__all__ = ["main"]

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "benchmarks"
RESULTS = ROOT / "benchmarks" / "results"
JOURNAL = "loop.jsonl"


def main() -> int:
    """Measure the cases, print and write the results."""
    arguments = options()
    efforts = efforts_of(arguments)
    journal = (arguments.results if arguments.results != RESULTS else BUILD) / JOURNAL
    surroundings = {"machine": machine(), "versions": dict(run_versions())}
    before = read_journal(journal, surroundings)
    stays = before if arguments.go_on else others(before, efforts)
    done = [record for record in stays if isinstance(record, Run) and record.case in efforts]
    try:
        floor = build_floor(BUILD)
    except (BuildToolError, subprocess.CalledProcessError) as error:
        print(f"cannot compile benchmarks/floor: {error}", file=sys.stderr)
        return 1
    write_journal(journal, surroundings, stays)
    with ExitStack() as stack:
        if "ROS_DOMAIN_ID" not in os.environ:
            os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(free_domain()))
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        measure_with_progress(efforts, done, floor, journal)
    return write_results(arguments.results, efforts, read_journal(journal, surroundings))


def measure_with_progress(
    efforts: Mapping[Case, Effort], done: Sequence[Run], floor: Path, journal: Path
) -> None:
    """Make the missing runs; show a progress bar on a terminal, and print a line per run."""
    turns = turns_of(efforts, done)
    whole_s = estimate_s(turns)
    console = Console()
    console.print(
        f"{len(efforts)} cases, {len(turns)} runs, {len(done)} done before: "
        f"about {clock(whole_s)} on an idle machine"
    )
    shown = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*shown, console=console) as progress:
        task = progress.add_task(f"about {clock(whole_s)} left", total=whole_s)

        def reported(run: Run, left_s: float) -> None:
            progress.console.print(f"{run.case}: {sentence(run)}", highlight=False, soft_wrap=True)
            whole = max(whole_s, left_s)
            progress.update(
                task, completed=whole - left_s, description=f"about {clock(left_s)} left"
            )

        def keep(record: Record) -> None:
            append_record(journal, record)

        run_suite(efforts, done, floor=floor, keep=keep, reported=reported)


def write_results(folder: Path, arguments: Mapping[Case, Effort], records: Sequence[Record]) -> int:
    """Write table, curves and JSON of all existing runs; return the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    cases = dict.fromkeys(record.case for record in records if isinstance(record, Run))
    suite = suite_of({case: effort_of(case) for case in cases} | dict(arguments), records)
    rows = rows_of(suite)
    write_json(folder / "loop.json", suite)
    write_table(folder / "loop.md", suite)
    for part in CURVES:
        if set(cases_of([part], CONTESTANTS, LAYOUTS)) <= cases.keys():
            draw_curve(folder, part, rows)
    print("", *disturbances(suite), "", *table(rows), f"\nwritten to {folder}", sep="\n")
    return int(not any(row.runs for row in rows))


def others(before: Sequence[Record], efforts: Mapping[Case, Effort]) -> tuple[Record, ...]:
    """The records of a journal to keep when some cases are measured again."""
    if not any(isinstance(record, Run) and record.case not in efforts for record in before):
        return ()
    return tuple(r for r in before if not isinstance(r, Run) or r.case not in efforts)


def efforts_of(arguments: argparse.Namespace) -> dict[Case, Effort]:
    """The number and duration of the runs of each case."""
    return {
        case: Effort(
            rounds=arguments.rounds or effort_of(case).rounds,
            seconds=arguments.seconds or effort_of(case).seconds,
        )
        for case in cases_of(arguments.parts, arguments.contestants, arguments.layouts)
    }


def options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.loop",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="run `work` only, once: a minute")
    parser.add_argument("--go-on", action="store_true", help="make only missing runs")
    parser.add_argument("--parts", nargs="+", choices=PARTS, help="default: all")
    parser.add_argument("--contestants", nargs="+", choices=CONTESTANTS, default=CONTESTANTS)
    parser.add_argument("--layouts", nargs="+", choices=LAYOUTS, default=LAYOUTS)
    parser.add_argument("--rounds", type=int, help="rounds; default: 9 for work, 2 for curves")
    parser.add_argument("--seconds", type=float, help="duration of each run; default: 3 and 2")
    parser.add_argument(
        "--results",
        type=Path,
        help="folder of the results; default: benchmarks/results, with --quick "
        "build/benchmarks/quick",
    )
    arguments = parser.parse_args()
    arguments.parts = arguments.parts or (["work"] if arguments.quick else list(PARTS))
    if arguments.quick:
        arguments.rounds, arguments.seconds = arguments.rounds or 1, arguments.seconds or 1.0
    arguments.results = arguments.results or (BUILD / "quick" if arguments.quick else RESULTS)
    return arguments


def sentence(run: Run) -> str:
    """The outcome of a run in one line."""
    if not isinstance(run.outcome, Figures):
        return f"failed: {run.outcome.why}"
    figures = run.outcome
    return (
        f"CPU {figures.cpu_percent:.0f} %, lateness p99 {figures.late_p99_us:.0f} us, "
        f"slowest node {figures.rate_hz:.1f} Hz, others {figures.others_percent:.0f} %, "
        f"stolen {figures.stolen_percent:.0f} %"
    )


def clock(seconds: float) -> str:
    """Minutes and seconds: `3:05`."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


if __name__ == "__main__":
    # Print each line immediately, even through a pipe.
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted; resume with --go-on")
