"""What a control loop costs and how exactly it keeps time, on several executors side by side.

    python -m benchmarks.loop [--quick] [--parts PART...] [--rounds N] [--seconds S]

Three nodes in a ring (simulator, estimator, controller), each with a timer, a publisher and a
subscription; in a process each, and all in one. Parts: the work itself at 1 kHz with 30 joints, and
curves over the number of nodes, the rate, the size of the messages. Writes `loop.json`, `loop.md`
and `loop_<part>.svg`. A contestant that cannot do its work is a result; exit code 1 where none can.
"""

import argparse
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.loop.cases import CONTESTANTS, LAYOUTS, PARTS, cases_of
from benchmarks.loop.figures import Figures
from benchmarks.loop.floor import build_floor
from benchmarks.loop.plots import CURVES, draw_curve
from benchmarks.loop.report import rows_of, table, write_json, write_table
from benchmarks.loop.suite import Run, estimate_s, run_suite
from obk_cli.adapters.free_domain import free_domain
from obk_interfaces.errors import BuildToolError

__all__ = ["main"]

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "benchmarks"
RESULTS = ROOT / "benchmarks" / "results"


def main() -> int:
    """Measure, tell, write."""
    asked = options()
    cases = cases_of(asked.parts, asked.contestants, asked.layouts)
    about_s = estimate_s(cases, rounds=asked.rounds, seconds=asked.seconds)
    total = asked.rounds * len(cases)
    print(f"{len(cases)} cases, {asked.rounds} rounds: about {clock(about_s)} on a quiet machine")
    try:
        floor = build_floor(BUILD)
    except (BuildToolError, subprocess.CalledProcessError) as error:
        print(f"the floor cannot be compiled: {error}", file=sys.stderr)
        return 1
    begin_s = time.monotonic()
    count = 0

    def told(run: Run) -> None:
        nonlocal count
        count += 1
        print(f"{count}/{total} {clock(time.monotonic() - begin_s)} {run.case}: {sentence(run)}")

    with ExitStack() as stack:
        if "ROS_DOMAIN_ID" not in os.environ:
            os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(free_domain()))
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        suite = run_suite(cases, rounds=asked.rounds, seconds=asked.seconds, floor=floor, told=told)
    asked.results.mkdir(parents=True, exist_ok=True)
    rows = rows_of(suite)
    write_json(asked.results / "loop.json", suite)
    write_table(asked.results / "loop.md", suite)
    for part in CURVES:
        if part in asked.parts:
            draw_curve(asked.results, part, rows)
    print("", *table(rows), f"\nwritten to {asked.results}", sep="\n")
    return int(not any(row.runs for row in rows))


def options() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.loop",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="the work alone, once, a minute")
    parser.add_argument("--parts", nargs="+", choices=PARTS, help="default: all")
    parser.add_argument("--contestants", nargs="+", choices=CONTESTANTS, default=CONTESTANTS)
    parser.add_argument("--layouts", nargs="+", choices=LAYOUTS, default=LAYOUTS)
    parser.add_argument("--rounds", type=int, help="default: 5")
    parser.add_argument("--seconds", type=float, help="of each run; default: 3")
    parser.add_argument(
        "--results",
        type=Path,
        help="folder; default: benchmarks/results, with --quick build/benchmarks",
    )
    asked = parser.parse_args()
    asked.parts = asked.parts or (["work"] if asked.quick else list(PARTS))
    asked.rounds = asked.rounds or (1 if asked.quick else 5)
    asked.seconds = asked.seconds or (1.0 if asked.quick else 3.0)
    asked.results = asked.results or (BUILD if asked.quick else RESULTS)
    return asked


def sentence(run: Run) -> str:
    """The outcome of a run in a line."""
    if not isinstance(run.outcome, Figures):
        return f"failed: {run.outcome.why}"
    figures = run.outcome
    return (
        f"CPU {figures.cpu_percent:.0f} %, lateness p99 {figures.late_p99_us:.0f} us, "
        f"slowest node {figures.rate_hz:.1f} Hz, others {figures.others_percent:.0f} %"
    )


def clock(seconds: float) -> str:
    """Minutes and seconds: `3:05`."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


if __name__ == "__main__":
    # Who is watching sees each line when it comes, also through a pipe.
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    sys.exit(main())
