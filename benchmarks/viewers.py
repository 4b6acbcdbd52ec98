"""Measure what viewers cost the simulation of the dummy stack, which steps at 1 kHz.

    python benchmarks/viewers.py [--seconds S]

Three cases: without a viewer, with a web viewer, and with its page open in a headless Chromium
(rendered without a GPU, at low priority). Each case is measured twice: in the stack, whose robot
publishes its real-time factor, and with the stepping loop alone in this process, which reports the
lateness of each step. Results go to `benchmarks/results/viewers.json`, with the load of the
machine, which has more influence than viewers do.
"""

import argparse
import json
import os
import platform
import queue
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import psutil

from obelisk_py.core.sim.mujoco.control import ControlInbox
from obelisk_py.core.sim.mujoco.simulation import Simulation
from obelisk_py.core.sim.mujoco.step_queue import StepQueue, StepResult
from obelisk_py.core.sim.mujoco.step_times import MonotonicClock, Pace
from obelisk_py.core.sim.mujoco.stepper import Stepper
from obelisk_py.core.sim.mujoco.viewers.processes import (
    ViewerHost,
    ViewerRequest,
    viewer_outputs,
)
from obelisk_py.core.sim.mujoco.viewers.viewer_controls import ViewerControls
from obelisk_py.core.sim.mujoco.viewers.viewer_requests import Report
from obelisk_spec.page_access import new_token

Result = dict[str, Any]

ROOT = Path(__file__).resolve().parents[1]
OBK = Path(sys.executable).with_name("obk")
RESULT = ROOT / "benchmarks" / "results" / "viewers.json"
DUMMY = ROOT / "examples" / "dummy" / "dummy.yaml"
STEPS_PER_VIEW = 5
"""The value in the dummy's config."""
SETTLE_S = 3.0
"""Wait after startup before measuring [s]."""
DEADLINE_S = 120.0
SHOWN = "the simulation is shown at "
DRAWN_BY_THE_CPU = (
    "--headless=new --no-sandbox --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --remote-debugging-port=0 --window-size=800,600"
).split()


def print_factors(seconds: float) -> None:
    """Receive the robot's real-time factors for some time and print them."""
    import rclpy
    from std_msgs.msg import Float64

    rclpy.init()
    node = rclpy.create_node("factors")
    factors: list[float] = []

    def note(message: Any) -> None:
        factors.append(message.data)

    node.create_subscription(Float64, "/obelisk_robot_0/rtf", note, 10)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps(factors))
    node.destroy_node()
    rclpy.try_shutdown()


class NotingClock(MonotonicClock):
    """A clock that records how late each sleep ended."""

    def __init__(self) -> None:
        self.late_ns: list[int] = []

    def sleep_until_ns(self, deadline_ns: int, stopped: Callable[[], bool]) -> int:
        now_ns = super().sleep_until_ns(deadline_ns, stopped)
        self.late_ns.append(now_ns - deadline_ns)
        return now_ns


def viewer_host(simulation: Simulation, reported: "queue.Queue[str]") -> ViewerHost:
    """A host whose viewers report their URLs; nothing can be requested."""
    controls = ViewerControls(
        simulation=simulation,
        queue=StepQueue(is_stepping=lambda: False),
        step=lambda: StepResult(is_done=False, text=""),
        reset=lambda _: StepResult(is_done=False, text=""),
        set_speed=lambda _: StepResult(is_done=False, text=""),
        report=lambda: Report(state="active", is_paused=False, realtime_factor=1.0),
        log=print,
    )
    return ViewerHost(
        controls=controls,
        name="dummy",
        token=new_token(),
        notify=lambda _, text: reported.put(text),
        show_page=reported.put,
    )


def lateness(
    viewers: tuple[ViewerRequest, ...], seconds: float, folder: Path, *, is_open: bool
) -> Result:
    """Measure the lateness of steps of the loop alone, with these viewers."""
    model = mujoco.MjModel.from_xml_path(str(DUMMY.with_name("dummy.xml")))
    simulation = Simulation(
        model, ControlInbox(field="u", size=model.nu, monotonic_s=time.monotonic)
    )
    simulation.reset(None)
    clock = NotingClock()
    reported: queue.Queue[str] = queue.Queue()
    with ExitStack() as closing:
        outputs = viewer_outputs(
            simulation,
            viewers,
            STEPS_PER_VIEW,
            host=viewer_host(simulation, reported),
            on_close=closing.callback,
        )
        stepper = Stepper(
            simulation,
            pace=Pace(simulation.step_s),
            clock=clock,
            outputs=outputs,
            stamp=lambda: 0,
            warn=print,
            report=lambda _: None,
        )
        if viewers:
            url = reported.get(timeout=DEADLINE_S)
            if is_open:
                closing.enter_context(page(url, folder))
                children = psutil.Process().children(recursive=True)
                wait_for_pages([p for p in children if "web" in p.cmdline()], 1)
        settled = time.monotonic() + SETTLE_S
        stepper.run(lambda: time.monotonic() > settled)
        clock.late_ns.clear()
        end = time.monotonic() + seconds
        stepper.run(lambda: time.monotonic() > end)
    late_us = np.array(clock.late_ns) / 1e3
    percentiles = {f"p{p:g}": float(np.percentile(late_us, p)) for p in (50, 90, 99)}
    return {"steps": len(late_us), "late_us": percentiles | {"max": float(late_us.max())}}


@contextmanager
def stack(*options: str, folder: Path) -> Iterator[tuple[psutil.Popen, Path]]:
    """Run the dummy stack until it is active; yield the launcher and its log."""
    log = folder / f"launch{'-'.join(options)}.log"
    with log.open("w") as output:
        launcher = psutil.Popen(
            [OBK, "launch", DUMMY, "--hang-after", "0", *options],
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        try:
            line_with("] active", log)
            yield launcher, log
        finally:
            launcher.send_signal(2)
            launcher.wait(DEADLINE_S)


def line_with(part: str, log: Path) -> str:
    """Wait for a line of the log that contains some text; return the line."""
    end = time.monotonic() + DEADLINE_S
    while time.monotonic() < end:
        for line in log.read_text().splitlines():
            if part in line:
                return line
        time.sleep(0.1)
    raise TimeoutError(f"no line with `{part}` in: {log.read_text()}")


@contextmanager
def page(url: str, folder: Path) -> Iterator[None]:
    """Open a page in a browser inside the `with` block."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    assert browser is not None, "Chromium is not installed: run `apt install chromium`"
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


def cpu_s(process: psutil.Process) -> float:
    """CPU time of a process so far [s]."""
    used = process.cpu_times()
    return used.user + used.system


def pages_of(viewers: list[psutil.Process]) -> int:
    """The number of pages connected to viewers; each page has one WebSocket."""
    connections = [c for p in viewers for c in p.net_connections("tcp4")]
    return sum(c.status == psutil.CONN_ESTABLISHED for c in connections)


def wait_for_pages(viewers: list[psutil.Process], count: int) -> None:
    """Wait until this number of pages is connected."""
    end = time.monotonic() + DEADLINE_S
    while pages_of(viewers) < count:
        assert time.monotonic() < end, "the page did not connect"
        time.sleep(0.1)


def measure(launcher: psutil.Popen, seconds: float, *, pages: int = 0) -> Result:
    """Measure the simulation of a running stack, after `pages` pages have connected."""
    below = launcher.children(recursive=True)
    viewers = [p for p in below if "web" in p.cmdline()]
    (robot,) = [p for p in below if "__node:=obelisk_robot_0" in p.cmdline()]
    wait_for_pages(viewers, pages)
    time.sleep(SETTLE_S)
    start = time.monotonic()
    before = [cpu_s(p) for p in (robot, *viewers)]
    received = subprocess.run(
        [sys.executable, __file__, "--print-factors", str(seconds)],
        stdout=subprocess.PIPE,
        check=True,
        timeout=seconds + DEADLINE_S,
    )
    took_s = time.monotonic() - start
    robot_s, *viewer_s = (
        cpu_s(p) - used_s for p, used_s in zip((robot, *viewers), before, strict=True)
    )
    factors = json.loads(received.stdout)
    return {
        "realtime_factor": {"mean": float(np.mean(factors)), "min": min(factors)},
        "pages_connected": pages_of(viewers),
        "robot_cores": robot_s / took_s,
        "viewer_cores": sum(viewer_s) / took_s,
        "load_average": os.getloadavg()[0],
    }


def main() -> int:
    """Measure, print and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--print-factors", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.print_factors:
        print_factors(options.print_factors)
        return 0
    web = (ViewerRequest(kind="web", arguments=("0",)),)
    seconds: float = options.seconds
    # A killed browser may still be writing files.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        os.environ |= {
            "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "99"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "OBK_HOME": name,
        }
        loop = {
            "no viewer": lateness((), seconds, folder, is_open=False),
            "web viewer": lateness(web, seconds, folder, is_open=False),
            "web viewer, one page open": lateness(web, seconds, folder, is_open=True),
        }
        stacks = {}
        with stack(folder=folder) as (launcher, _):
            stacks["no viewer"] = measure(launcher, seconds)
        with stack("--viewer", "web", folder=folder) as (launcher, log):
            url = line_with(SHOWN, log).partition(SHOWN)[2].split()[0]
            stacks["web viewer"] = measure(launcher, seconds)
            with page(url, folder):
                stacks["web viewer, one page open"] = measure(launcher, seconds, pages=1)
    result = {
        "step_ms": 1.0,
        "cases": {case: loop[case] | stacks[case] for case in loop},
        "cores": os.cpu_count(),
        "machine": platform.machine(),
    }
    text = json.dumps(result, indent=1)
    RESULT.write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
