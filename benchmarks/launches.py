"""Launch and stop the dummy stack repeatedly, and check for leftovers.

    python -m benchmarks.launches [--rounds N] [--kills N] [--large N]

Each round activates the stack and shuts it down; a few rounds do so with thirty nodes. Each kill
sends SIGKILL to the launcher at a random time during bring-up. No process of a round and none of
its files in shared memory may be left. Times and leftovers go to
`benchmarks/results/launches.json`; exit code 1 if anything failed or was left.
"""

import argparse
import json
import os
import platform
import random
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import yaml

from benchmarks.stolen import StolenTime, warn_of_stolen_time

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
DUMMY_NEW = DUMMY.with_name("dummy_new.yaml")
SPARE = {"control": 14, "estimation": 13}
"""Section -> nodes in addition to those of the dummy, thirty in all."""
RESULT = ROOT / "benchmarks" / "results" / "launches.json"
SHARED_MEMORY = Path("/dev/shm")
LTTNG_PREFIX = "lttng-ust-wait"
"""LTTng creates files with these names once on each machine, and keeps them."""
MARK = "OBK_LAUNCHES_BENCHMARK"
GONE_S = 2.0
"""Time after a kill by which no process may be left [s]."""


@dataclass
class Tally:
    """Times and faults of all launches."""

    up_s: list[float] = field(default_factory=list)
    thirty_up_s: list[float] = field(default_factory=list)
    down_s: list[float] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    left_over: list[str] = field(default_factory=list)


def thirty_nodes(folder: Path) -> Path:
    """Write a config of the dummy with 27 more nodes at 100 Hz; return its path."""
    dummy = yaml.safe_load(DUMMY_NEW.read_text(encoding="utf-8"))
    dummy["robot"]["sim"]["model_xml_path"] = str(DUMMY_NEW.with_name("dummy.xml"))
    dummy["control"]["params_path"] = str(DUMMY_NEW.with_name("dummy_params.txt"))
    for section, topic in (("control", "/spare/ctrl"), ("estimation", "/spare/est")):
        node = dummy[section]
        spare = {
            **node,
            "publishers": [{**node["publishers"][0], "topic": topic}],
            "timers": [{**node["timers"][0], "timer_period_sec": 0.01}],
        }
        dummy[section] = [node, *[spare] * SPARE[section]]
    path = folder / "thirty.yaml"
    path.write_text(yaml.safe_dump({**dummy, "config": "thirty"}), encoding="utf-8")
    return path


def main() -> int:
    """Run all rounds and kills."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--large", type=int, default=5, help="launches of thirty nodes")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    before = set(SHARED_MEMORY.iterdir())
    tally, stolen = Tally(), StolenTime()
    with tempfile.TemporaryDirectory(prefix="obk-launches-") as home:
        environment = {**os.environ, "OBK_HOME": home, MARK: home}
        thirty = thirty_nodes(Path(home))
        for number in range(arguments.rounds):
            launch_and_end(DUMMY, environment, tally, tally.up_s)
            print(f"\r{number + 1} of {arguments.rounds} rounds", end="", flush=True)
        for number in range(arguments.large):
            launch_and_end(thirty, environment, tally, tally.thirty_up_s)
            print(f"\r{number + 1} of {arguments.large} of thirty nodes", end="", flush=True)
        moments = random.Random(arguments.seed)
        for number in range(arguments.kills):
            kill_during_bring_up(environment, moments.uniform(0.0, 2.0), tally)
            print(f"\r{number + 1} of {arguments.kills} kills   ", end="", flush=True)
    stolen_percent = stolen.percent()
    tally.left_over += unused_files(before)
    print()
    warn_of_stolen_time(stolen_percent)
    return report(tally, arguments, stolen_percent)


def launch_and_end(
    config: Path, environment: dict[str, str], tally: Tally, up_s: list[float]
) -> None:
    """Launch until active, then send SIGINT."""
    start = time.monotonic()
    process = subprocess.Popen(
        [OBK, "launch", config, "--format", "json", "--quiet"],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    lines = []
    with process.stdout as output:
        for line in output:
            lines.append(line)
            event = json.loads(line)
            if event["event"] == "Phase" and event["name"] == "active":
                up_s.append(time.monotonic() - start)
                start = time.monotonic()
                process.send_signal(2)
    if process.wait() != 0:
        tally.failed.append(lines[-1] if lines else "no output")
    elif config == DUMMY:
        tally.down_s.append(time.monotonic() - start)
    note_processes(environment, tally, 0.0)


def kill_during_bring_up(environment: dict[str, str], after_s: float, tally: Tally) -> None:
    """Launch and kill the launcher during bring-up."""
    process = subprocess.Popen(
        [OBK, "launch", DUMMY, "--quiet"], env=environment, stdout=subprocess.DEVNULL
    )
    time.sleep(after_s)
    process.kill()
    process.wait()
    note_processes(environment, tally, GONE_S)


def note_processes(environment: dict[str, str], tally: Tally, within_s: float) -> None:
    """Record processes of the benchmark that are still running after a while."""
    end = time.monotonic() + within_s
    while (found := marked(environment[MARK])) and time.monotonic() < end:
        time.sleep(0.02)
    tally.left_over += found


def marked(mark: str) -> list[str]:
    """Processes other than this one that have the mark in their environment."""
    found = []
    for process in psutil.process_iter():
        try:
            is_ours = process.pid != os.getpid() and process.environ().get(MARK) == mark
            if is_ours and process.status() != psutil.STATUS_ZOMBIE:
                found.append(" ".join(process.cmdline()))
        except psutil.Error:
            continue
    return found


def unused_files(before: set[Path]) -> list[str]:
    """New files in shared memory that no process uses; other running stacks use theirs."""
    created = set(SHARED_MEMORY.iterdir()) - before
    new = {str(path) for path in created if not path.name.startswith(LTTNG_PREFIX)}
    used = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        try:
            text = maps.read_text()
        except OSError:  # the process has ended, or belongs to another user
            continue
        used |= {path for path in new if path in text}
    # The small files next to a segment or a port are open but not mapped.
    stems = {Path(path).name.removesuffix("_el").removesuffix("_sl") for path in used}
    return sorted(path for path in new if not any(stem in path for stem in stems))


def report(tally: Tally, arguments: argparse.Namespace, stolen_percent: float) -> int:
    """Print and write the results."""
    figures = {
        "machine": f"{platform.machine()}, {os.cpu_count()} processors",
        "stolen_percent": stolen_percent,
        "rounds": arguments.rounds,
        "kills": arguments.kills,
        "up_s": spread(tally.up_s),
        "thirty_up_s": spread(tally.thirty_up_s),
        "down_s": spread(tally.down_s),
        "failed": tally.failed,
        "left_over": tally.left_over,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(figures, indent=1))
    return 1 if tally.failed or tally.left_over else 0


def spread(values: list[float]) -> dict[str, float]:
    """Minimum, median and maximum."""
    return {
        "min": round(min(values, default=0.0), 3),
        "median": round(statistics.median(values or [0.0]), 3),
        "max": round(max(values, default=0.0), 3),
    }


if __name__ == "__main__":
    sys.exit(main())
