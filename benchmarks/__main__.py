"""Run all benchmarks that have a goal, one after another.

    python -m benchmarks [--parts PART...] [--go-on] [--peer PATH]

Prints the expected duration first. --go-on resumes an interrupted run: it skips programs that have
finished and runs of the loop that exist. Each program writes its own results; at the end they are
compared with their goals in `benchmarks/results/goals.md`. Exit code 1 if a program failed; the
programs after it still run.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

__all__ = ["PROGRAMS", "Program", "left_of", "main"]

ROOT: Final = Path(__file__).resolve().parents[1]
DONE: Final = ROOT / "build" / "benchmarks" / "done"
"""The programs that have finished in this run, one per line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """One benchmark program."""

    name: str
    command: tuple[str, ...]
    """Arguments of `python -m`; they shorten programs that would take too long in full."""
    minutes: float
    """Approximate duration on an idle machine."""


PROGRAMS: Final = (
    Program(name="looking", command=("benchmarks.looking", "--runs", "3"), minutes=1.0),
    Program(
        name="watched",
        command=("benchmarks.watched", "--seconds", "8", "--rounds", "3"),
        minutes=3.3,
    ),
    Program(name="tool", command=("benchmarks.tool", "--repeats", "4"), minutes=1.3),
    Program(
        name="launches",
        command=("benchmarks.launches", "--rounds", "15", "--kills", "5", "--large", "3"),
        minutes=1.5,
    ),
    Program(
        name="simulator",
        command=("benchmarks.simulator", "--only", "cost", "realtime"),
        minutes=1.7,
    ),
    Program(name="lockstep", command=("benchmarks.lockstep", "--rounds", "3"), minutes=2.5),
    Program(
        name="loop",
        command=("benchmarks.loop", "--parts", "work", "nodes", "rate"),
        minutes=8.5,
    ),
)


def left_of(
    programs: Iterable[Program], parts: Collection[str], done: Collection[str]
) -> tuple[Program, ...]:
    """The requested programs that have not finished yet."""
    return tuple(p for p in programs if p.name in parts and p.name not in done)


def main() -> int:
    """Run the programs, report progress and write the summary."""
    arguments = options()
    done = DONE.read_text(encoding="utf-8").split() if arguments.go_on and DONE.exists() else []
    programs = left_of(PROGRAMS, arguments.parts, done)
    DONE.parent.mkdir(parents=True, exist_ok=True)
    DONE.write_text("".join(f"{name}\n" for name in done), encoding="utf-8")
    console = Console()
    console.print(_plan(programs), f"about {_minutes(programs)} on an idle machine", sep="\n")
    start_s, failed = time.monotonic(), []
    for place, program in enumerate(programs):
        elapsed_min = (time.monotonic() - start_s) / 60
        console.rule(
            f"{program.name}, {place + 1} of {len(programs)}: {elapsed_min:.0f} min elapsed, "
            f"about {_minutes(programs[place:])} left"
        )
        if subprocess.run(_command(program, arguments), cwd=ROOT, check=False).returncode:
            failed.append(program.name)
        else:
            with DONE.open("a", encoding="utf-8") as ended:
                ended.write(f"{program.name}\n")
    subprocess.run([sys.executable, "-m", "benchmarks.summary"], cwd=ROOT, check=True)
    console.print(f"took {(time.monotonic() - start_s) / 60:.0f} min; see benchmarks/results")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return int(bool(failed))


def options() -> argparse.Namespace:
    """Parse the command line."""
    names = [program.name for program in PROGRAMS]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--parts", nargs="+", choices=names, default=names)
    parser.add_argument("--go-on", action="store_true", help="resume an interrupted run")
    parser.add_argument(
        "--peer",
        default=str(ROOT / "build" / "peer" / "bin" / "check-jsonschema"),
        help="path of a check-jsonschema executable",
    )
    return parser.parse_args()


def _command(program: Program, arguments: argparse.Namespace) -> list[str]:
    more = {"tool": [arguments.peer], "loop": ["--go-on"] if arguments.go_on else []}
    return [sys.executable, "-m", *program.command, *more.get(program.name, [])]


def _plan(programs: Iterable[Program]) -> Table:
    table = Table("program", "minutes")
    for program in programs:
        table.add_row(" ".join(program.command), f"{program.minutes:g}")
    return table


def _minutes(programs: Iterable[Program]) -> str:
    return f"{sum(program.minutes for program in programs):.0f} min"


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted; resume with `make bench GO_ON=1`")
