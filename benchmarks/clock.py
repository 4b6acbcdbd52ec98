"""What simulated time costs the nodes of the dummy stack, by its source.

`python -m benchmarks.clock` from the root of the checkout. The stack of `examples/dummy` (robot,
estimator and controller at 1 kHz, a process each) runs in turns with wall time, with the clock
page, and with `/clock` only, as a stack without a page does. Processor time is read from the
kernel, in percent of one core, over some seconds after the bring-up; rates are those that nodes
report.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any, Final

import psutil

CONFIG: Final = Path(__file__).resolve().parents[1] / "examples" / "dummy" / "dummy.yaml"
OBK: Final = Path(sys.executable).with_name("obk")
# The launch without a page: what `with_clock_page` gives where it cannot give one.
WITHOUT_PAGE: Final = """
import sys
from contextlib import nullcontext
import obk_cli.launch.run as run
run.with_clock_page = lambda plan, units, commands: nullcontext(commands)
from obk_cli.cli.main import main
sys.exit(main())
"""
SOURCES: Final[dict[str, tuple[list[str], list[str]]]] = {
    "wall time": ([str(OBK)], ["--set", "obk.use_sim_time=false"]),
    "clock page": ([str(OBK)], []),
    "/clock": ([sys.executable, "-c", WITHOUT_PAGE], []),
}
ROUNDS: Final = 3
WARM_UP_S: Final = 3.0
MEASURED_S: Final = 6.0
NODES: Final = ("robot", "estimation", "control")


def measure(program: list[str], options: list[str]) -> dict[str, float]:
    """Processor time of each node [% of a core] and reported rates [Hz] of one run."""
    command = [*program, "launch", str(CONFIG), "--quiet", *options]
    launch = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        stack = _active_stack()
        time.sleep(WARM_UP_S)
        pids = {node["section"]: node["pid"] for node in stack["nodes"]}
        before = {name: _used_s(pids[name]) for name in NODES}
        time.sleep(MEASURED_S)
        used = {name: (_used_s(pids[name]) - before[name]) / MEASURED_S * 100 for name in NODES}
        rates = {
            f"{rate['name']} [Hz]": rate["measured_hz"]
            for node in _stacks()[0]["nodes"]
            for rate in node["rates"]
            if rate["name"] in ("timer_ctrl", "timer_est", "steps")
        }
    finally:
        launch.send_signal(2)
        launch.wait(60)
    return {**{f"{name} [%]": value for name, value in used.items()}, **rates}


def _used_s(pid: int) -> float:
    times = psutil.Process(pid).cpu_times()
    return times.user + times.system


def _stacks() -> list[dict[str, Any]]:
    done = subprocess.run([OBK, "ps", "--format", "json"], capture_output=True, check=False)
    stacks: list[dict[str, Any]] = json.loads(done.stdout)["stacks"] if done.stdout else []
    return [stack for stack in stacks if stack["domain"] == int(os.environ["ROS_DOMAIN_ID"])]


def _active_stack() -> dict[str, Any]:
    while not (stacks := [stack for stack in _stacks() if stack["state"] == "active"]):
        time.sleep(0.2)
    return stacks[0]


def main() -> None:
    """Run all sources in turns, and print the medians as a table."""
    os.environ.setdefault("ROS_DOMAIN_ID", "71")
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in SOURCES}
    for _ in range(ROUNDS):
        for name, (program, options) in SOURCES.items():
            runs[name].append(measure(program, options))
            print(name, runs[name][-1], f"load {os.getloadavg()[0]:.1f}", flush=True)
    keys = list(runs["wall time"][0])
    print("", "| |", " | ".join(keys), "|\n|---|" + "---|" * len(keys))
    for name, results in runs.items():
        figures = (f"{median(result[key] for result in results):.1f}" for key in keys)
        print(f"| {name} | " + " | ".join(figures) + " |")


if __name__ == "__main__":
    main()
