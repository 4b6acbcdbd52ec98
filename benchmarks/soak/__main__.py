"""Inject faults into the dummy stack for a long time, and check for leaks and leftovers.

    make bench PART=soak [SECONDS=1800]
    make bench PART=soak-short    (about 1 min: each fault at least once, and fast leaks)

A seeded plan picks faults at random: it changes the states of nodes, kills and freezes them;
changes the config and launches again; starts and stops monitors, recorders and pages. The soak
checks the outcome of each. Memory, file handles, threads and sockets of the stack's processes and
their files in shared memory must not grow by more than noise. Between faults every expected rate
must be kept, in seconds in which a bare timer next to the stack kept its own. The verdict goes to
`soak.json`, samples and (with the `plot` extra) a plot to build/benchmarks. Exit code 1: something
leaks, a rate is broken, a fault has a wrong outcome, or something is left.
"""

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from benchmarks.soak.counts import LEAST_MB, mapped_files, of_process, shared_files, verdicts
from benchmarks.soak.plan import Trouble, first_deck, plan
from benchmarks.soak.rates import Rates, bare_timer_beside
from benchmarks.soak.results import RESULTS, keep_result
from benchmarks.soak.stack import Stack
from benchmarks.soak.troubles import trouble
from benchmarks.stolen import StolenTime
from obk_cli.process.shared_memory import remove_dead_segments
from obk_cli.ros.domains import free_domain

__all__ = ["main"]

ROOT: Final = Path(__file__).resolve().parents[2]
CONFIG: Final = ROOT / "examples" / "dummy" / "dummy.yaml"
SAMPLE_S: Final = 2.0
FROZEN_S: Final = 5.0
"""Nodes are not frozen if `--hang-after` is longer than this, which would take too long [s]."""


class Soak:
    """One run, with its samples and its faults."""

    def __init__(self, stack: Stack, draw: random.Random, calm_s: float) -> None:
        self.stack = stack
        self.samples: list[dict[str, Any]] = []
        self.troubles: list[dict[str, Any]] = []
        self.rates = Rates()
        self._draw = draw
        self._calm_s = calm_s
        self._mapped: set[str] = set()

    def run(self, seconds: float, turns: Iterator[Trouble], least: int, timer: Any) -> None:
        """Inject faults for some time, and at least `least` of them."""
        self.stack.launch()
        calm_at_s = self.stack.now() + self._calm_s
        while self.stack.now() < seconds or len(self.troubles) < least:
            start_s = time.monotonic()
            nodes = self.sample()
            if self.stack.now() >= calm_at_s:
                if timer is not None:
                    self.rates.look(nodes.values(), timer.newest(), self.stack.now())
                kind = next(turns)
                started_s = self.stack.now()
                trouble(self.stack, kind, self._draw)
                self.note(kind, started_s)
                calm_at_s = self.stack.now() + self._calm_s
            time.sleep(max(0.0, min(SAMPLE_S, self._calm_s) - (time.monotonic() - start_s)))
        self.stack.stop_observers()
        self.stack.stop()

    def note(self, kind: Trouble, started_s: float) -> None:
        """Record and print a fault."""
        now_s = self.stack.now()
        done = {
            "time_s": round(started_s, 1),
            "took_s": round(now_s - started_s, 1),
            "trouble": kind,
        }
        self.troubles.append(done)
        print(f"{now_s:.0f} s: {kind}, {len(self.stack.faults)} failures so far", file=sys.stderr)

    def sample(self) -> dict[str, dict[str, Any]]:
        """Measure every process of the stack; return the nodes."""
        nodes = self.stack.nodes()
        launcher = self.stack.launcher.pid if self.stack.launcher else 0
        owners = {node["pid"]: name for name, node in nodes.items() if node["pid"]}
        at_s = round(self.stack.now(), 2)
        for pid, who in {launcher: "launcher", **owners}.items():
            self._mapped |= mapped_files(pid)
            if counts := of_process(pid):
                self.samples.append({"time_s": at_s, "who": who, "pid": pid, **counts})
        shared = {"who": "shared memory", "pid": 0, "shm_files": len(self.shared_files())}
        self.samples.append({"time_s": at_s, **shared})
        return nodes

    def shared_files(self) -> set[str]:
        """Files of the stack in shared memory, including those of killed processes."""
        return self._mapped & shared_files()


def soak(arguments: argparse.Namespace, home: Path) -> dict[str, Any]:
    """Run the soak and return the result."""
    draw = random.Random(arguments.seed)
    is_frozen = arguments.hang_after <= FROZEN_S
    least = len(first_deck(random.Random(arguments.seed), is_frozen=is_frozen))
    options = ("--on-crash", "restart", "--hang-after", f"{arguments.hang_after:g}")
    stolen, stack = StolenTime(), Stack.of(arguments.config, home, options)
    run = Soak(stack, draw, arguments.calm)
    remove_dead_segments()  # of processes that were killed before
    with nullcontext() if arguments.without_rates else bare_timer_beside() as timer:
        run.run(arguments.seconds, plan(draw, is_frozen=is_frozen), least, timer)
    left, found = stack.leftovers(), verdicts(run.samples, least_mb=arguments.least_mb)
    shared = sorted(run.shared_files())
    faults = [*stack.faults, *(f"traceback: {line}" for line in stack.tracebacks())]
    grown = [one for one in found if not one["is_flat"]]
    is_sound = not (faults or run.rates.faults or left or shared or grown)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(stack.now()),
        "seed": arguments.seed,
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "stolen_percent": stolen.percent(),
        "is_sound": is_sound,
        "verdict": verdict(is_sound, run.rates),
        "faults": faults,
        "left": {"processes": left, "shm_files": shared},
        "rates": {"judged": run.rates.judged, "void": run.rates.void, "broken": run.rates.faults},
        "grown": grown,
        "judged": found,
        "troubles": run.troubles,
        "samples": [
            {key: round(v, 2) if isinstance(v, float) else v for key, v in one.items()}
            for one in run.samples
        ],
    }


def verdict(is_sound: bool, rates: Rates) -> str:
    """The result as text, which mentions if the machine was never idle enough to judge rates."""
    sound = "sound" if is_sound else "NOT sound"
    return sound if rates.judged else f"{sound}; rates were not judged"


def options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.soak",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=1800.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", type=float, default=6.0, help="seconds between two faults")
    parser.add_argument(
        "--hang-after", type=float, default=2.0, help="`--hang-after` of `obk launch` [s]"
    )
    parser.add_argument(
        "--least-mb",
        type=float,
        default=LEAST_MB,
        help="growth of a process that always counts as flat [MB]; in a short run, each kind of "
        "observer starts for the first time while growth is judged",
    )
    parser.add_argument(
        "--without-rates", action="store_true", help="do not judge rates, for a busy machine"
    )
    parser.add_argument("--config", type=Path, default=CONFIG, help="config; its folder is copied")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    return parser.parse_args()


def main() -> int:
    """Run the soak, write and print the result."""
    arguments = options()
    with ExitStack() as held:
        if "ROS_DOMAIN_ID" not in os.environ:
            os.environ["ROS_DOMAIN_ID"] = str(held.enter_context(free_domain()))
        result = soak(arguments, Path(held.enter_context(tempfile.TemporaryDirectory())))
    keep_result(result, arguments.results / "soak.json")
    shown = ("verdict", "load_average", "stolen_percent", "faults", "left", "rates", "grown")
    print(json.dumps({key: result[key] for key in shown}, indent=1))
    return 0 if result["is_sound"] else 1


if __name__ == "__main__":
    sys.exit(main())
