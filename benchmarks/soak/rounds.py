"""Take one process through its lifecycle many times, and check for leaks.

    python -m benchmarks.soak.rounds [--rounds 1000]

The launcher deactivates, cleans up, configures and activates the dummy stack, composed in one
process. The resources of that process and of the launcher are measured. The verdict goes to
`rounds.json`, samples and (with the `plot` extra) a plot to build/benchmarks. Exit code 1:
something leaks, or a transition fails.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from rich.progress import track

from benchmarks.soak.counts import of_process, verdicts
from benchmarks.soak.results import RESULTS, keep_result
from benchmarks.soak.stack import Stack
from benchmarks.stolen import StolenTime
from obk_cli.introspect.lifecycle import LifecycleRequest, change_states
from obk_cli.ros.domains import free_domain
from obk_cli.ros.environment import ros_environment

__all__ = ["main"]

ROOT: Final = Path(__file__).resolve().parents[2]
CONFIG: Final = ROOT / "examples" / "dummy" / "dummy.yaml"
ROUND: Final = ("deactivate", "cleanup", "configure", "activate")
TRANSITION_S: Final = 30.0
SAMPLES: Final = 200
LEAST_JUDGED_S: Final = 1.0
"""Short enough for a test with few rounds; a thousand rounds take minutes."""


def run_rounds(stack: Stack, rounds: int) -> list[dict[str, Any]]:
    """Run all rounds unless one fails; return the samples."""
    environment, arguments = ros_environment(), LifecycleRequest(timeout_s=TRANSITION_S)
    samples: list[dict[str, Any]] = []
    for number in track(range(rounds), "rounds"):
        if number % max(1, rounds // SAMPLES) == 0:
            samples += sample(stack)
        for transition in ROUND:
            answer = change_states(environment, transition, arguments)
            if not answer.success:
                stack.blame(f"{transition} in round {number}: {answer.why}")
                return samples
    return samples + list(sample(stack))


def sample(stack: Stack) -> Iterator[dict[str, Any]]:
    """Measure the resources of both processes."""
    assert stack.launcher is not None
    (composed,) = {node["pid"] for node in stack.nodes().values()}
    for who, pid in {"launcher": stack.launcher.pid, "composed nodes": composed}.items():
        if counts := of_process(pid):
            yield {"time_s": round(stack.now(), 2), "who": who, "pid": pid, **counts}


def measure(arguments: argparse.Namespace, home: Path) -> dict[str, Any]:
    """Run the rounds and return the result."""
    stolen, stack = (
        StolenTime(),
        Stack.of(arguments.config, home, ("--composed", "--hang-after", "20")),
    )
    stack.launch()
    samples = run_rounds(stack, arguments.rounds)
    stack.stop()
    found = verdicts(samples, LEAST_JUDGED_S)
    return {
        "rounds": arguments.rounds,
        "seconds": round(stack.now()),
        "cores": os.cpu_count(),
        "stolen_percent": stolen.percent(),
        "is_sound": bool(found) and all(one["is_flat"] for one in found) and not stack.faults,
        "faults": stack.faults,
        "judged": found,
        "troubles": [],
        "samples": samples,
    }


def main() -> int:
    """Run the rounds, write and print the result."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.soak.rounds",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--config", type=Path, default=CONFIG, help="config; its folder is copied")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    arguments = parser.parse_args()
    with ExitStack() as held:
        if "ROS_DOMAIN_ID" not in os.environ:
            os.environ["ROS_DOMAIN_ID"] = str(held.enter_context(free_domain()))
        home = Path(held.enter_context(tempfile.TemporaryDirectory()))
        os.environ |= {"OBK_HOME": str(home), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        result = measure(arguments, home)
    keep_result(result, arguments.results / "rounds.json")
    shown = {key: result[key] for key in ("seconds", "stolen_percent", "is_sound", "faults")}
    print(json.dumps({**shown, "judged": result["judged"]}, indent=1))
    return 0 if result["is_sound"] else 1


if __name__ == "__main__":
    sys.exit(main())
