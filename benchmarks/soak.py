"""Troubles the dummy stack for a long time, and looks whether anything of it grows or is left.

    make soak [SECONDS=1800]      (SECONDS=180: whether it runs, and what grows quickly)

A seeded plan takes turns at random: nodes are taken through transitions, killed (and brought back),
monitors and recorders come and go, the stack is stopped and launched anew. Every 2 s memory, file
handles, threads and sockets of the stack's processes, and the files in /dev/shm, are counted; those
of a process are told by its node, whichever process runs it. Between troubles every promised rate
has to be kept. Numbers and verdict go to `benchmarks/results/soak.json`, and with the extra `plot`
a picture to `soak.png`. Exit code 1: something grows, is not kept, or is left.
"""

import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import psutil

from obk_cli.adapters.shared_memory import remove_dead_segments

ROOT: Final = Path(__file__).resolve().parents[1]
OBK: Final = Path(sys.executable).with_name("obk")
CONFIG: Final = ROOT / "examples" / "dummy" / "dummy.yaml"
RESULT: Final = ROOT / "benchmarks" / "results" / "soak.json"
SAMPLE_S: Final = 2.0
CALM_S: Final = 6.0
"""After a trouble, before rates are looked at [s]: their figures are those of the last second."""
WAIT_S: Final = 60.0
"""For a stack to be active, or gone [s]."""
WARM_PART: Final = 0.3
"""Of the samples of a process, that are not judged: caches fill."""
TOLERANCES: Final = {"rss_mb": 0.05, "pss_mb": 0.05, "handles": 0.0, "threads": 0.0, "sockets": 0.0}
"""Growth over the judged time that counts as flat, as a part of the mean."""
LEAST: Final = {"rss_mb": 3.0, "pss_mb": 3.0, "handles": 2.0, "threads": 1.0, "sockets": 2.0}
"""Growth that counts as flat in any case."""
DOMAIN: Final = "97"


@dataclass
class Soak:
    """One run: the stack, what was done to it, what was counted."""

    home: Path
    draw: random.Random
    begin: float = field(default_factory=time.monotonic)
    launcher: subprocess.Popen[bytes] | None = None
    samples: list[dict[str, Any]] = field(default_factory=list)
    troubles: list[dict[str, Any]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    company: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def environment(self) -> dict[str, str]:
        own = {"OBK_HOME": str(self.home), "ROS_DOMAIN_ID": DOMAIN}
        return {**os.environ, **own, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

    def now(self) -> float:
        return time.monotonic() - self.begin

    def obk(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [OBK, *words],
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=2 * WAIT_S,
            check=False,
        )

    def start(self, *words: str) -> subprocess.Popen[bytes]:
        nowhere = subprocess.DEVNULL
        return subprocess.Popen(
            [OBK, *words], env=self.environment, stdout=nowhere, stderr=nowhere, cwd=self.home
        )

    def stack(self) -> dict[str, Any]:
        """What `obk ps` says of it; empty where it does not run."""
        told = self.obk("ps", "--format", "json")
        stacks = json.loads(told.stdout)["stacks"] if told.returncode == 0 else []
        return stacks[0] if stacks else {}

    def wait_for(self, what: str, condition: Callable[[], object]) -> bool:
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.3)
        self.faults.append(f"{self.now():.0f} s: never came: {what}")
        return False

    def is_active(self) -> bool:
        stack = self.stack()
        nodes = stack.get("nodes", ())
        return bool(nodes) and all(node["state"] == "active" for node in nodes)


def launch(soak: Soak) -> None:
    soak.launcher = soak.start("launch", str(CONFIG), "--quiet", "--on-crash", "restart")
    soak.wait_for("a stack that is active", soak.is_active)


def stop(soak: Soak) -> None:
    assert soak.launcher is not None
    soak.launcher.send_signal(signal.SIGINT)
    try:
        code = soak.launcher.wait(WAIT_S)
    except subprocess.TimeoutExpired:
        soak.launcher.kill()
        code = soak.launcher.wait()
    if code not in (0, 1):
        soak.faults.append(f"{soak.now():.0f} s: the launcher ended with {code}")


def relaunch(soak: Soak) -> None:
    stop(soak)
    launch(soak)


def transitions(soak: Soak) -> None:
    nodes = [node["node"] for node in soak.stack().get("nodes", ())]
    chosen = soak.draw.choice(nodes) if nodes and soak.draw.random() < 0.7 else ""
    deep = soak.draw.random() < 0.5
    down, up = (
        (["deactivate", "cleanup"], ["configure", "activate"])
        if deep
        else (
            ["deactivate"],
            ["activate"],
        )
    )
    for verb in (*down, *up):
        done = soak.obk("lifecycle", verb, *([chosen] if chosen else []))
        if done.returncode:
            soak.faults.append(f"{soak.now():.0f} s: {verb} {chosen}: {done.stderr.strip()[:200]}")
    soak.wait_for(f"active after {chosen or 'all'} went down", soak.is_active)


def kill_node(soak: Soak) -> None:
    pids = [node["pid"] for node in soak.stack().get("nodes", ()) if node["pid"]]
    if pids:
        os.kill(soak.draw.choice(pids), signal.SIGKILL)
        time.sleep(1.0)
        soak.wait_for("active after a kill", soak.is_active)


def onlooker(soak: Soak) -> None:
    words = soak.draw.choice(
        (
            ("record", "-o", f"r{len(soak.company)}.mcap"),
            ("web", "--port", "0"),
            ("topic", "hz", "/obelisk/dummy/est"),
        )
    )
    soak.company.append(soak.start(*words))


def onlooker_leaves(soak: Soak) -> None:
    for process in soak.company:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            soak.faults.append(f"{soak.now():.0f} s: an onlooker did not end: {process.args}")
            process.kill()
            process.wait()
    soak.company.clear()


TROUBLES: Final[Sequence[tuple[int, Callable[[Soak], None]]]] = (
    (5, transitions),
    (2, kill_node),
    (3, onlooker),
    (3, onlooker_leaves),
    (1, relaunch),
)


def sample(soak: Soak) -> None:
    """Count what every process of the stack has."""
    shared = len(shared_files())
    soak.samples.append({"time_s": soak.now(), "who": "machine", "pid": 0, "shm_files": shared})
    launcher = soak.launcher.pid if soak.launcher else 0
    owners = {node["pid"]: node["node"] for node in soak.stack().get("nodes", ()) if node["pid"]}
    for pid, who in {launcher: "launcher", **owners}.items():
        try:
            process = psutil.Process(pid)
            memory = process.memory_full_info()
            links = [str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir()]
            threads = process.num_threads()
        except (psutil.Error, OSError):
            continue  # it has ended meanwhile
        counts = {
            "rss_mb": memory.rss / 1e6,
            "pss_mb": memory.pss / 1e6,
            "handles": len(links),
            "sockets": sum(link.startswith("socket:") for link in links),
            "threads": threads,
        }
        soak.samples.append({"time_s": soak.now(), "who": who, "pid": pid, **counts})


def shared_files() -> set[str]:
    """The files in shared memory, where DDS keeps its segments."""
    return {path.name for path in Path("/dev/shm").iterdir()}


def look_at_rates(soak: Soak) -> None:
    for node in soak.stack().get("nodes", ()):
        for rate in node["rates"]:
            if rate["standing"] == "broken":
                name, wanted, measured = rate["name"], rate["wanted_hz"], rate["measured_hz"]
                soak.faults.append(
                    f"{soak.now():.0f} s: {node['node']} {name}: {measured:.0f} of {wanted:.0f} Hz"
                )


def growth(times: Sequence[float], values: Sequence[float]) -> float:
    """By how much the values have grown over the time, by the slope of a straight line."""
    if len(set(times)) < 3:
        return 0.0
    return statistics.linear_regression(times, values).slope * (times[-1] - times[0])


def verdicts(samples: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each process that lived long enough and each count: whether it is flat."""
    by_process: defaultdict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for one in samples:
        by_process[one["who"], one["pid"]].append(one)
    found = []
    for (who, pid), own in by_process.items():
        judged = own[int(WARM_PART * len(own)) :]
        if who == "machine" or len(judged) < 5:
            continue
        for key, tolerance in TOLERANCES.items():
            values = [one[key] for one in judged]
            grown = growth([one["time_s"] for one in judged], values)
            allowed = max(LEAST[key], tolerance * statistics.mean(values))
            found.append(
                {
                    "who": who,
                    "pid": pid,
                    "count": key,
                    "samples": len(values),
                    "mean": round(statistics.mean(values), 2),
                    "grown": round(grown, 2),
                    "allowed": round(allowed, 2),
                    "is_flat": grown <= allowed,
                }
            )
    return found


def run(seconds: float, seed: int, home: Path) -> dict[str, Any]:
    """All of it."""
    soak = Soak(home=home, draw=random.Random(seed))
    remove_dead_segments()  # of whoever was killed before
    launch(soak)
    next_trouble = soak.now() + CALM_S
    while soak.now() < seconds:
        begin = time.monotonic()
        sample(soak)
        if soak.now() >= next_trouble:
            look_at_rates(soak)
            weights, kinds = zip(*TROUBLES, strict=True)
            (trouble,) = soak.draw.choices(kinds, weights)
            soak.troubles.append({"time_s": round(soak.now(), 1), "trouble": trouble.__name__})
            trouble(soak)
            next_trouble = soak.now() + CALM_S
        time.sleep(max(0.0, begin + SAMPLE_S - time.monotonic()))
    onlooker_leaves(soak)
    stop(soak)
    left = json.loads(soak.obk("ps", "--format", "json").stdout)
    mine = [process for process in left["leftovers"] if process["run"].startswith("dummy")]
    shared = remove_dead_segments()
    found = verdicts(soak.samples)
    is_sound = not (soak.faults or mine or shared) and all(one["is_flat"] for one in found)
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": seconds,
        "seed": seed,
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "verdict": "flat" if is_sound else "NOT flat",
        "faults": soak.faults,
        "left": {"processes": mine, "dead_shm_files": shared},
        "grown": [one for one in found if not one["is_flat"]],
        "judged": found,
        "troubles": soak.troubles,
        "samples": [
            {key: round(v, 2) if isinstance(v, float) else v for key, v in one.items()}
            for one in soak.samples
        ],
    }


def draw_picture(result: dict[str, Any], path: Path) -> None:
    """Memory, handles, threads over time, with the troubles as lines."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(4, 1, sharex=True, figsize=(9, 9), layout="constrained")
    for axis, key in zip(axes, ("rss_mb", "handles", "threads", "shm_files"), strict=True):
        for who in dict.fromkeys(one["who"] for one in result["samples"] if key in one):
            own = [one for one in result["samples"] if one["who"] == who]
            axis.plot([one["time_s"] for one in own], [one[key] for one in own], ".", label=who)
        for trouble in result["troubles"]:
            axis.axvline(trouble["time_s"], color="0.85", linewidth=0.7, zorder=0)
        axis.set_ylabel(key.replace("_", " "))
        axis.set_ylim(bottom=0)
    axes[0].legend(fontsize="small")
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=100)


def main() -> int:
    """Run, tell, keep."""
    parser = argparse.ArgumentParser(prog="python benchmarks/soak.py")
    parser.add_argument("--seconds", type=float, default=1800.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        result = run(options.seconds, options.seed, Path(home))
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    try:
        draw_picture(result, RESULT.with_suffix(".png"))
    except ImportError:
        print("no picture: install obk with its `plot` extra", file=sys.stderr)
    shown = ("verdict", "load_average", "faults", "left", "grown")
    print(json.dumps({key: result[key] for key in shown}, indent=1))
    return 0 if result["verdict"] == "flat" else 1


if __name__ == "__main__":
    sys.exit(main())
