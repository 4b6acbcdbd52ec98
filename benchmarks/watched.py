"""Measure whether the dummy stack keeps its rates while it is monitored, and what that costs.

    python -m benchmarks.watched [--seconds S] [--rounds N]

Launches the stack with one process per node and composed in one, alone and watched. When watched,
`obk monitor` runs, and a lifecycle service of each node is called once a second. Ticks are the
nodes' own counts on `/diagnostics`. Results go to `benchmarks/results/watched.json`.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetState
from rclpy.executors import SingleThreadedExecutor

from benchmarks.stolen import StolenTime, warn_of_stolen_time
from obk_cli.launch.ros_nodes import rates_of
from obk_cli.ros.domains import free_domain

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
RESULT = ROOT / "benchmarks" / "results" / "watched.json"
NODES = ("obelisk_robot_0", "obelisk_estimation_0", "obelisk_control_0")
UP_S = 60.0
"""Time by which the stack must be active [s]."""
SETTLE_S = 3.0
LAYOUTS = {"separate": (), "composed": ("--composed",)}


class Counts:
    """The ticks that nodes report: `(time [s], ticks)` of each rate."""

    def __init__(self) -> None:
        self.reported: dict[str, list[tuple[float, int]]] = {}
        self.expected_hz: dict[str, float] = {}

    def take(self, message: DiagnosticArray) -> None:
        """Store a node's counts."""
        received = rates_of(message)
        if received is not None:
            stamp = message.header.stamp
            for rate in received.rates:
                name = f"{received.node} {rate.name}"
                self.expected_hz[name] = rate.expected_hz
                seen = self.reported.setdefault(name, [])
                seen.append((stamp.sec + stamp.nanosec * 1e-9, rate.ticks))

    def kept(self) -> dict[str, float]:
        """The achieved fraction of each expected rate, from the first count to the last."""
        return {
            name: (seen[-1][1] - seen[0][1]) / (seen[-1][0] - seen[0][0]) / self.expected_hz[name]
            for name, seen in sorted(self.reported.items())
            if len(seen) > 1
        }


@contextmanager
def stack(options: Sequence[str]) -> Iterator[psutil.Process]:
    """Run the dummy stack; it is active when entered."""
    command = [str(OBK), "launch", str(DUMMY), "--format", "json", *options]
    launch = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    is_up = threading.Event()

    def read() -> None:
        assert launch.stdout is not None
        for line in launch.stdout:
            reported = json.loads(line)
            if reported["event"] == "Phase" and reported["name"] == "active":
                is_up.set()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        if not is_up.wait(UP_S):
            raise TimeoutError(f"the stack was not active within {UP_S:g} s")
        time.sleep(SETTLE_S)
        yield psutil.Process(launch.pid)
    finally:
        launch.send_signal(2)
        launch.wait(30)
        reader.join(10)


@contextmanager
def monitor() -> Iterator[psutil.Process]:
    """Run `obk monitor`, which prints its whole state twice a second."""
    process = psutil.Popen(
        [OBK, "monitor", "--format", "json"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.send_signal(2)
        process.wait(20)


def measure(options: Sequence[str], seconds: float, *, is_watched: bool) -> dict[str, Any]:
    """Measure one stack for some time."""
    counts = Counts()
    with stack(options) as launcher, ExitStack() as held:
        watcher = held.enter_context(monitor()) if is_watched else None
        node = rclpy.create_node("watched")
        held.callback(node.destroy_node)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        held.callback(executor.shutdown)
        clients = [node.create_client(GetState, f"/{name}/get_state") for name in NODES]
        answers = []
        if is_watched:
            time.sleep(SETTLE_S)
        node.create_subscription(DiagnosticArray, "/diagnostics", counts.take, 100)
        begin, used, stolen = time.monotonic(), _cpu_s(watcher), StolenTime()
        next_call = begin
        while (now := time.monotonic()) < begin + seconds:
            if is_watched and now >= next_call:
                next_call += 1.0
                answers += [client.call_async(GetState.Request()) for client in clients]
            executor.spin_once(timeout_sec=0.2)
        took = time.monotonic() - begin
        return {
            "kept": counts.kept(),
            "calls": len(answers),
            "answered": sum(answer.done() for answer in answers),
            "monitor_cores": (_cpu_s(watcher) - used) / took,
            "stolen_percent": stolen.percent(),
            "processes": len(launcher.children(recursive=True)),
        }


def watched_to_alone(runs: Mapping[str, Sequence[Mapping[str, Any]]], layout: str) -> float:
    """Median ratio of the slowest rate while watched to the slowest rate alone."""
    alone, watched = runs[f"{layout}, alone"], runs[f"{layout}, watched"]
    return statistics.median(
        _least_kept(one) / _least_kept(other) for one, other in zip(watched, alone, strict=True)
    )


def _least_kept(run: Mapping[str, Any]) -> float:
    return min(map(float, run["kept"].values()))


def _cpu_s(process: psutil.Process | None) -> float:
    if process is None:
        return 0.0
    times = process.cpu_times()
    return float(times.user + times.system)


def main() -> int:
    """Measure in turns, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    runs: dict[str, list[dict[str, Any]]] = {}
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(prefix="obk-watched-") as home, free_domain() as domain:
        os.environ |= {
            "OBK_HOME": home,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        rclpy.init()
        for _ in range(arguments.rounds):
            for layout, options in LAYOUTS.items():
                for is_watched in (False, True):
                    name = f"{layout}, {'watched' if is_watched else 'alone'}"
                    run = measure(options, arguments.seconds, is_watched=is_watched)
                    runs.setdefault(name, []).append(run)
                    print(name, json.dumps(run))
        rclpy.shutdown()
    warn_of_stolen_time(max(run["stolen_percent"] for found in runs.values() for run in found))
    result = {
        "seconds": arguments.seconds,
        "least_kept": {name: min(map(_least_kept, found)) for name, found in runs.items()},
        "watched_to_alone": {layout: watched_to_alone(runs, layout) for layout in LAYOUTS},
        "monitor_cores": statistics.median(
            run["monitor_cores"]
            for name, found in runs.items()
            if "watched" in name
            for run in found
        ),
        "runs": runs,
        "load_average": load,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
