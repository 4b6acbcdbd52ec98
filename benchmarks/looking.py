"""Measure commands that inspect a running stack, and the cost of counting messages.

    python -m benchmarks.looking [--runs N] [--topics N] [--rate HZ] [--seconds S]

Runs each command N times in a new process, on the dummy stack, and takes the median duration. Then
one process publishes on many topics at a high rate and `obk topic hz` counts the messages. The
result has the CPU use of `obk topic hz`, and how many messages it counted and were published. It
goes to `benchmarks/results/looking.json`. Exit code 1 if messages are neither counted nor reported
as lost.
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
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

from benchmarks.stolen import StolenTime, warn_of_stolen_time
from obk_cli.ros.environment import AS_THE_PROFILE_SAYS, LOCALHOST_PROFILE

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
RESULT = ROOT / "benchmarks" / "results" / "looking.json"
DOMAIN = "98"
START_S = 60.0
"""Time by which the stack must be active [s]."""
LAST_COUNT_S = 2.5
"""Time until `obk topic hz`, which prints its counts once a second, has printed the last [s]."""
COMMANDS = (
    "topic echo --help",
    "lifecycle get",
    "topic list",
    "topic info est",
    "topic echo est --once",
    "topic echo est q_joints[0] --once",
    "topic hz est --duration 0.1",
    "topic delay imu --duration 0.1",
    "node list",
    "node info control_0",
    "param list control_0",
    "param get control_0 use_sim_time",
    "param set control_0 use_sim_time true",
    "param dump control_0",
    "service list",
    "service call obelisk_robot_0/get_state",
    "topic pub est '{q_joints: [0.0]}' --once",
    "topic pub ctrl '{u_mujoco: [0.0]}' --once --allow-foreign",
)
COMPLETION = {
    "_OBK_COMPLETE": "complete_bash",
    "COMP_WORDS": "obk topic echo im",
    "COMP_CWORD": "3",
}


def environment(folder: Path) -> dict[str, str]:
    """The environment of every process: isolated from the user's stacks, with compiled modules."""
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {
        **inherited,
        "PYTHONPYCACHEPREFIX": str(folder / "compiled"),
        "ROS_DOMAIN_ID": DOMAIN,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": AS_THE_PROFILE_SAYS,
        "FASTRTPS_DEFAULT_PROFILES_FILE": LOCALHOST_PROFILE,
        "OBK_HOME": str(folder),
    }


@contextmanager
def stack(variables: dict[str, str]) -> Iterator[None]:
    """Run the dummy stack; it is active when entered.

    Raises:
        SystemExit: the stack did not become active in time.
    """
    launch = subprocess.Popen(
        [OBK, "launch", DUMMY, "--quiet"], env=variables, stdout=subprocess.PIPE, text=True
    )
    assert launch.stdout is not None
    deadline = threading.Timer(START_S, launch.kill)
    deadline.start()
    try:
        is_active = any("] active" in line for line in launch.stdout)
        deadline.cancel()
        if not is_active:
            raise SystemExit(f"the stack ended, or was not active within {START_S:g} s")
        yield
    finally:
        launch.send_signal(2)
        launch.communicate(timeout=30)


def seconds_of(words: list[str], runs: int, variables: dict[str, str]) -> dict[str, float]:
    """Wall time and CPU time of a command [s]."""
    took, used = [], []
    for run in range(1 + runs):
        before, begin = os.times(), time.monotonic()
        subprocess.run([OBK, *words], env=variables, check=True, capture_output=True, timeout=60)
        seconds = time.monotonic() - begin
        after = os.times()
        if run == 0:  # the first run compiles the modules
            continue
        took.append(seconds)
        used.append(
            after.children_user
            + after.children_system
            - before.children_user
            - before.children_system
        )
    return {
        "median_s": statistics.median(took),
        "longest_s": max(took),
        "cpu_s": statistics.median(used),
    }


def counting(
    topics: int, rate_hz: float, seconds: float, variables: dict[str, str]
) -> dict[str, Any]:
    """Run `obk topic hz` on many topics with a high rate."""
    words = (str(topics), str(rate_hz), str(seconds))
    publisher = subprocess.Popen(
        [sys.executable, ROOT / "benchmarks" / "recording.py", "--publish", *words],
        env=variables,
        stdout=subprocess.PIPE,
        text=True,
    )
    names = [f"/load/t{number:02}" for number in range(topics)]
    with tempfile.TemporaryFile("w+") as output:  # a pipe without a reader would block it
        counter = psutil.Popen(
            [OBK, "topic", "hz", *names, "--format", "json", "--timeout", "60"],
            env=variables,
            stdout=output,
        )
        reported = json.loads(publisher.communicate(timeout=seconds * 5 + 60)[0])
        used = counter.cpu_times()
        time.sleep(LAST_COUNT_S)
        counter.send_signal(2)
        counter.wait(60)
        output.seek(0)
        lines = [json.loads(line) for line in output]
    last = {line["topic"]: line for line in lines}
    return {
        "topics": topics,
        "rate_hz": reported["each"] / reported["seconds"],
        "measured_hz": statistics.median(line["rate_hz"] for line in lines),
        "published": reported["each"] * topics,
        "counted": sum(line["count"] for line in last.values()),
        "told_as_lost": sum(line["lost"] for line in last.values()),
        # Includes its startup and its wait for the publisher.
        "cores": (used.user + used.system) / reported["seconds"],
    }


def main() -> int:
    """Measure, print and write the result."""
    import shlex

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--topics", type=int, default=20)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    stolen = StolenTime()
    with tempfile.TemporaryDirectory() as folder:
        variables = environment(Path(folder))
        with stack(variables):
            commands = {
                words: seconds_of(shlex.split(words), options.runs, variables) for words in COMMANDS
            }
            commands["completion"] = seconds_of([], options.runs, {**variables, **COMPLETION})
        counted = counting(options.topics, options.rate, options.seconds, variables)
    stolen_percent = stolen.percent()
    warn_of_stolen_time(stolen_percent)
    result = {
        "commands": commands,
        "counting": counted,
        "stolen_percent": stolen_percent,
        "load_average": os.getloadavg()[0],
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0 if counted["published"] == counted["counted"] + counted["told_as_lost"] else 1


if __name__ == "__main__":
    sys.exit(main())
