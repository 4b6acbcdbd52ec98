"""Measure what each source of simulated time costs the nodes of the dummy stack.

Run `python -m benchmarks.clock` from the root of the checkout. The stack of `examples/dummy`
(robot, estimator and controller at 1 kHz, one process per node) takes turns with wall time, with
the clock page, and with `/clock` only, as if no page existed. CPU time comes from the kernel and
is divided by the ticks that the node reports, because a busy machine changes the number of ticks.
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
# Launches without a page, with what `with_clock_page` returns if it cannot create one.
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
MEASURED_S: Final = 8.0
TICKS: Final = {"robot": "steps", "estimation": "timer_est", "control": "timer_ctrl"}
"""Section -> the rate whose ticks are counted; nodes report it once a second."""


def measure(program: list[str], options: list[str]) -> dict[str, float]:
    """Measure one run: CPU time per tick or step [us] and tick rate [Hz] of each node."""
    command = [*program, "launch", str(CONFIG), "--quiet", *options]
    launch = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        stack = _active_stack()
        time.sleep(WARM_UP_S)
        pids = {node["section"]: node["pid"] for node in stack["nodes"]}
        start_s, before = time.monotonic(), _counts(pids)
        time.sleep(MEASURED_S)
        took_s, after = time.monotonic() - start_s, _counts(pids)
    finally:
        launch.send_signal(2)
        launch.wait(60)
    figures = {}
    for section in TICKS:
        (used_s, ticks), (used_before_s, ticks_before) = after[section], before[section]
        new = ticks - ticks_before
        figures[f"{section} [us/tick]"] = (used_s - used_before_s) / new * 1e6
        figures[f"{section} [Hz]"] = new / took_s
    return figures


def _counts(pids: dict[str, int]) -> dict[str, tuple[float, int]]:
    """CPU time [s] and ticks of each section."""
    ticks = {
        node["section"]: rate["ticks"]
        for node in _active_stack()["nodes"]
        for rate in node["rates"]
        if rate["name"] == TICKS[node["section"]]
    }
    return {section: (_used_s(pids[section]), ticks[section]) for section in TICKS}


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
    """Run all sources in turn and print the medians as a table."""
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
