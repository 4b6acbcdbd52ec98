"""Measure what lockstep runs cost, and check that they are deterministic.

    python -m benchmarks.lockstep [--only PART...] [--rounds N] [--trials N]

Everything is recorded, as in a test. Seconds are CPU time of the whole process unless noted, which
other load on the machine disturbs least. Each part runs in its own process.

- factors: simulated seconds per second of CPU time, of the three examples and of 31 nodes at 1 kHz
  each; the best round, and all rounds.
- trials: trials of 5 s per minute in a warm process, including the creation of their nodes.
- start: startup of a further trial of the arm until its nodes are active, and its shutdown.
- memory: resident memory during 200 trials of the arm.
- cold: wall time of `obk test` with one run of 5 s, and of the tests of `examples/arm`.
- digests: digests of five runs in one process, and in each of three with other hash seeds.

It writes `benchmarks/results/lockstep.json`; exit code 1 if digests differ.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import psutil
import yaml

from benchmarks.stolen import StolenTime, warn_of_stolen_time
from obelisk_py.core.lockstep.interception import intercepted
from obk_testing.programs import load_stack
from obk_testing.trial import StackTrial

ROOT: Final = Path(__file__).resolve().parents[1]
OBK: Final = Path(sys.executable).with_name("obk")
RESULT: Final = ROOT / "benchmarks" / "results" / "lockstep.json"
BUILD: Final = ROOT / "build" / "benchmarks" / "lockstep"
EXAMPLES: Final = {
    "dummy": ROOT / "examples" / "dummy" / "dummy_new.yaml",
    "arm": ROOT / "examples" / "arm" / "arm.yaml",
    "quadruped": ROOT / "examples" / "quadruped" / "quadruped.yaml",
}
LOOPS: Final = 15
"""Pairs of a controller and an estimator in the config of many nodes, next to one simulator."""
SETTINGS: Final = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}
TRIAL_S: Final = 5.0
DIGEST_S: Final = 0.5
SHORT_S: Final = 0.5
MB: Final = 1e6


def many_nodes() -> Path:
    """Write a config of 31 nodes at 1 kHz: the dummy with 15 controllers and estimators."""
    dummy = yaml.safe_load(EXAMPLES["dummy"].read_text(encoding="utf-8"))
    control, estimation = dummy["control"], dummy["estimation"]
    dummy["robot"]["sim"]["model_xml_path"] = str(EXAMPLES["dummy"].with_name("dummy.xml"))
    dummy["control"], dummy["estimation"] = [], []
    for number in range(LOOPS):
        command = "/obelisk/dummy/ctrl" if number == 0 else f"/loop_{number}/ctrl"
        controller = {k: v for k, v in control.items() if k != "params_path"}
        publisher = {**control["publishers"][0], "topic": command}
        estimate = {"topic": f"/loop_{number}/est"}
        subscriber = {**control["subscribers"][0], **estimate}
        dummy["control"].append(
            {**controller, "publishers": [publisher], "subscribers": [subscriber]}
        )
        output = {**estimation["publishers"][0], **estimate}
        dummy["estimation"].append({**estimation, "publishers": [output]})
    BUILD.mkdir(parents=True, exist_ok=True)
    path = BUILD / "many.yaml"
    path.write_text(yaml.safe_dump({**dummy, "config": "many"}), encoding="utf-8")
    return path


def factors(arguments: argparse.Namespace) -> dict[str, Any]:
    """Simulated seconds per second of CPU time."""
    found: dict[str, Any] = {}
    for name, config in {**EXAMPLES, "many": many_nodes()}.items():
        duration_s = 1.0 if name == "many" else 3.0
        stack = load_stack(config)
        rounds = []
        for seed in range(arguments.rounds):
            with StackTrial(stack, seed=seed) as trial:
                rounds.append(duration_s / used_s(partial(trial.run, duration_s)))
        stack.close()
        found[name] = {"best": round(max(rounds), 2), "rounds": [round(each, 2) for each in rounds]}
    return found


def trials(arguments: argparse.Namespace) -> dict[str, Any]:
    """Trials of 5 s per minute of CPU time, including startup and shutdown of the nodes."""
    found: dict[str, Any] = {}
    for name, config in EXAMPLES.items():
        stack = load_stack(config)
        seconds = [
            used_s(partial(whole_trial, stack, TRIAL_S)) for _ in range(arguments.rounds + 1)
        ]
        stack.close()
        found[name] = {"per_minute": round(60 / min(seconds[1:]), 1)}
    return found


def start(_arguments: argparse.Namespace) -> dict[str, Any]:
    """CPU time to activate the nodes of a further trial of the arm, and to shut it down."""
    stack, starts, ends = load_stack(EXAMPLES["arm"]), [], []
    for seed in range(40):
        start_s = time.process_time()
        trial = StackTrial(stack, seed=seed)
        active_s = time.process_time()
        trial.run(0.01)
        over_s = time.process_time()
        trial.close()
        starts.append(1e3 * (active_s - start_s))
        ends.append(1e3 * (time.process_time() - over_s))
    stack.close()
    return {
        "first_ms": round(starts[0], 1),
        "further_ms": round(statistics.median(starts[1:]), 1),
        "end_ms": round(statistics.median(ends), 1),
    }


def memory(arguments: argparse.Namespace) -> dict[str, Any]:
    """Resident memory [MB] during trials of the arm."""
    stack, process, sizes = load_stack(EXAMPLES["arm"]), psutil.Process(), []
    for _ in range(arguments.trials):
        whole_trial(stack, SHORT_S)
        sizes.append(process.memory_info().rss / MB)
    stack.close()
    return {
        "trials": arguments.trials,
        "first_mb": round(sizes[0], 1),
        "last_mb": round(sizes[-1], 1),
        "most_mb": round(max(sizes), 1),
    }


def digests(_arguments: argparse.Namespace) -> dict[str, Any]:
    """The different digests of five runs of each example."""
    found: dict[str, Any] = {}
    for name, config in EXAMPLES.items():
        stack = load_stack(config)
        found[name] = sorted({whole_trial(stack, DIGEST_S) for _ in range(5)})
        stack.close()
    return found


def cold(_arguments: argparse.Namespace) -> dict[str, Any]:
    """Wall time of whole commands [s], the faster of two runs."""
    with tempfile.TemporaryDirectory(prefix="obk-cold-") as folder:
        test, config = Path(folder) / "test_one_run.py", str(EXAMPLES["dummy"])
        test.write_text(
            f"def test_run(stack):\n    stack({config!r}).run({TRIAL_S})\n", encoding="utf-8"
        )
        kept = ["--output", folder]
        one_run = [config, str(test), *kept]
        arm = [str(EXAMPLES["arm"]), *kept]
        return {
            "one_run_s": min(obk_test_s(one_run) for _ in range(2)),
            "tests_of_arm_s": min(obk_test_s(arm) for _ in range(2)),
        }


def obk_test_s(words: list[str]) -> float:
    """Wall time of one `obk test` command [s]."""
    start_s = time.monotonic()
    subprocess.run([OBK, "test", *words], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return round(time.monotonic() - start_s, 2)


PARTS: Final[dict[str, Callable[[argparse.Namespace], dict[str, Any]]]] = {
    "factors": factors,
    "trials": trials,
    "start": start,
    "memory": memory,
    "cold": cold,
    "digests": digests,
}


def used_s(call: Callable[[], object]) -> float:
    """CPU time that this process uses in a call [s]."""
    start_s = time.process_time()
    call()
    return time.process_time() - start_s


def whole_trial(stack: Any, duration_s: float) -> str:
    """Create, run and close a trial; return its digest."""
    with StackTrial(stack, seed=1) as trial:
        return str(trial.run(duration_s).digest())


def in_a_process(part: str, arguments: argparse.Namespace, hash_seed: int) -> dict[str, Any]:
    """Run a part in its own process."""
    words = ["--part", part, "--rounds", str(arguments.rounds), "--trials", str(arguments.trials)]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.lockstep", *words],
        cwd=ROOT,
        env={**os.environ, **SETTINGS, "PYTHONHASHSEED": str(hash_seed)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(prog="benchmarks.lockstep")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Run the parts, write the results and compare the digests."""
    arguments = options()
    if arguments.part is not None:
        with intercepted():
            print(json.dumps(PARTS[arguments.part](arguments)))
        return 0
    stolen = StolenTime()
    result: dict[str, Any] = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    same = True
    for part in arguments.only:
        result[part] = in_a_process(part, arguments, 0)
        if part == "digests":
            found = [result[part], *(in_a_process(part, arguments, seed) for seed in (1, 2, 3))]
            sets = {name: {d for each in found for d in each[name]} for name in EXAMPLES}
            result[part] = {name: sorted(each) for name, each in sets.items()}
            same = all(len(each) == 1 for each in sets.values())
        print(part, json.dumps(result[part]), flush=True)
    result["machine"] = {
        "python": platform.python_version(),
        "cpus": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
    }
    result["stolen_percent"] = stolen.percent()
    warn_of_stolen_time(result["stolen_percent"])
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
