"""Measures what looking at the dummy stack costs its simulation, which steps at 1 kHz.

    python benchmarks/viewers.py [--seconds S]

The stack runs with nobody looking, with a web viewer, and with a web viewer whose page is open in a
headless Chromium (drawn without a GPU, niced). From outside: the real-time factor that the robot
publishes, and the time between the stamps of two steps, which the stepping thread puts on the
encoders' messages. They go to `benchmarks/results/viewers.json`.
"""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
RESULT = ROOT / "benchmarks" / "results" / "viewers.json"
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
STEP_S = 0.001
SETTLE_S = 5.0
"""For what has started to come to rest [s]."""
DEADLINE_S = 120.0
SHOWN = "the simulation is shown at "
DRAWN_BY_THE_CPU = (
    "--headless=new --no-sandbox --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --remote-debugging-port=0 --window-size=800,600"
).split()


def listen(seconds: float) -> None:
    """Take the stamps of steps and the real-time factors for some time; prints them."""
    import rclpy
    from obelisk_sensor_msgs.msg import ObkJointEncoders
    from std_msgs.msg import Float64

    rclpy.init()
    node = rclpy.create_node("listener")
    stamps_ns: list[int] = []
    factors: list[float] = []

    def note(message: ObkJointEncoders) -> None:
        stamp = message.header.stamp
        stamps_ns.append(stamp.sec * 1_000_000_000 + stamp.nanosec)

    node.create_subscription(ObkJointEncoders, "/obelisk/dummy/obk_joint_encoders", note, 1000)
    node.create_subscription(
        Float64, "/obelisk_robot_0/rtf", lambda message: factors.append(message.data), 10
    )
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps({"stamps_ns": stamps_ns, "factors": factors}))
    node.destroy_node()
    rclpy.try_shutdown()


@contextmanager
def stack(*options: str, folder: Path) -> Iterator[tuple[psutil.Popen, Path]]:
    """The dummy, active; its launcher and what it writes."""
    log = folder / f"launch{'-'.join(options)}.log"
    with log.open("w") as output:
        launcher = psutil.Popen(
            [OBK, "launch", DUMMY, *options], stdout=output, stderr=subprocess.STDOUT
        )
        try:
            line_with("] active", log)
            yield launcher, log
        finally:
            launcher.send_signal(2)
            launcher.wait(DEADLINE_S)


def line_with(part: str, log: Path) -> str:
    """The line with these words, waited for."""
    end = time.monotonic() + DEADLINE_S
    while time.monotonic() < end:
        for line in log.read_text().splitlines():
            if part in line:
                return line
        time.sleep(0.1)
    raise TimeoutError(f"`{part}` never came: {log.read_text()}")


@contextmanager
def page(url: str, folder: Path) -> Iterator[None]:
    """Have a page open in a browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    assert browser is not None, "there is no Chromium: apt install chromium"
    process = psutil.Popen(
        ["nice", "-n", "15", browser, *DRAWN_BY_THE_CPU, f"--user-data-dir={folder / 'user'}", url],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        for child in process.children(recursive=True):
            child.kill()
        process.kill()
        process.wait()


def pages_of(viewers: list[psutil.Process]) -> int:
    """How many pages are connected to viewers; each has one WebSocket."""
    connections = [c for p in viewers for c in p.net_connections("tcp4")]
    return sum(c.status == psutil.CONN_ESTABLISHED for c in connections)


def measure(case: str, launcher: psutil.Popen, seconds: float, *, pages: int = 0) -> dict[str, Any]:
    """How the steps of a running stack go, once so many pages are connected."""
    viewers = [p for p in launcher.children(recursive=True) if "web" in p.cmdline()]
    end = time.monotonic() + DEADLINE_S
    while pages_of(viewers) < pages:
        assert time.monotonic() < end, "the page does not connect"
        time.sleep(0.1)
    time.sleep(SETTLE_S)
    before = [p.cpu_times() for p in viewers]
    heard = subprocess.run(
        [sys.executable, __file__, "--listen", str(seconds)],
        stdout=subprocess.PIPE,
        check=True,
        timeout=seconds + DEADLINE_S,
    )
    after = [p.cpu_times() for p in viewers]
    connected = pages_of(viewers)
    told = json.loads(heard.stdout)
    between_ms = np.diff(told["stamps_ns"]) / 1e6
    return {
        "case": case,
        "steps_heard": len(told["stamps_ns"]),
        "step_ms": STEP_S * 1e3,
        "between_steps_ms": {
            f"p{percent:g}": float(np.percentile(between_ms, percent)) for percent in (50, 99, 99.9)
        }
        | {"max": float(between_ms.max())},
        "realtime_factor": {
            "mean": float(np.mean(told["factors"])),
            "min": float(np.min(told["factors"])),
        },
        "pages_connected": connected,
        "viewer_cores": sum(
            b.user + b.system - a.user - a.system for a, b in zip(before, after, strict=True)
        )
        / seconds,
        "load_average": os.getloadavg()[0],
    }


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--listen", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listen:
        listen(options.listen)
        return 0
    cases = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ |= {
            "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "99"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "OBK_HOME": name,
        }
        with stack(folder=folder) as (launcher, _):
            cases.append(measure("nobody looks", launcher, options.seconds))
        with stack("--viewer", "web", folder=folder) as (launcher, log):
            url = line_with(SHOWN, log).partition(SHOWN)[2].split()[0]
            cases.append(measure("web viewer", launcher, options.seconds))
            with page(url, folder):
                case = "web viewer, one page open"
                cases.append(measure(case, launcher, options.seconds, pages=1))
    result = {"cases": cases, "cores": os.cpu_count(), "machine": platform.machine()}
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
