"""Make pictures of a running stack: the output of `obk launch`, the monitor, and the web page.

It starts the dummy stack in the ROS domain of `ROS_DOMAIN_ID`. It needs the `monitor` and `web`
extras, playwright and Chromium. No test covers this module, because every picture is different.
"""

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from generated import ROOT
from pictures import PICTURES, terminal, without_fonts
from playwright.sync_api import sync_playwright

from obk_cli.cli.options import TIMEOUT_S, with_types
from obk_cli.introspect.target import target_of
from obk_cli.monitor.app import MonitorApp
from obk_cli.monitor.parameters import StackParameters
from obk_cli.monitor.stack_follower import StackFollower, StackSelector
from obk_cli.ros.environment import ros_environment
from obk_cli.runs.folder import runs_folder

__all__ = ["make_live_pictures"]

OBK = Path(sys.executable).with_name("obk")
DUMMY = "examples/dummy/dummy_new.yaml"
WARM_S = 20
"""Time until plots and rates are representative [s]."""
SHOWN = ("/obelisk/dummy/est q_joints", "/obelisk/dummy/imu angular_velocity.y")


def make_live_pictures() -> None:
    """Write `launch.svg`, `monitor.svg` and `web.png`."""
    output = subprocess.run(
        [OBK, "launch", DUMMY, "--duration", "2", "--quiet", "--color", "always"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    # Show the default folder of the logs, not the one of this machine.
    shown = re.sub(r"logs in \S+/runs/", "logs in ~/.local/state/obk/runs/", output)
    picture = terminal(f"$ obk launch {DUMMY} --duration 2 --quiet\n{shown}", "obk launch", 100)
    (PICTURES / "launch.svg").write_text(picture, encoding="utf-8")
    with _stack():
        asyncio.run(_monitor())
        _page()


@contextmanager
def _stack() -> Iterator[None]:
    """Run the dummy stack; it is active inside the `with` block."""
    command = [str(OBK), "launch", str(DUMMY), "--color", "never"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as launch:
        assert launch.stdout is not None
        next(line for line in launch.stdout if line.endswith("] active\n"))
        try:
            yield
        finally:
            launch.send_signal(signal.SIGINT)
            launch.stdout.read()


async def _monitor() -> None:
    place = target_of(ros_environment(), None, TIMEOUT_S)
    target = StackSelector(environment=place.environment, domain=None, run=None)
    app = MonitorApp(
        StackFollower(target, with_types, 1.0),
        target.change,
        StackParameters(runs_folder(os.environ)),
    )
    async with app.run_test(size=(100, 26)) as pilot:
        await asyncio.sleep(WARM_S)
        await pilot.press("down", "d")
        await pilot.pause()
        picture = app.export_screenshot(title="obk monitor")
        await pilot.press("n", "q")
    app.stop_following()
    (PICTURES / "monitor.svg").write_text(without_fonts(picture), encoding="utf-8")


def _page() -> None:
    command = [str(OBK), "web", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        address = serving.stdout.readline().split()[-1]
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=shutil.which("chromium"), args=["--no-sandbox"]
                )
                page = browser.new_page(viewport={"width": 1200, "height": 1210})
                page.goto(f"{address}#{'&'.join(f'plot={one}' for one in SHOWN)}")
                page.wait_for_timeout(WARM_S * 1000)
                page.screenshot(path=PICTURES / "web.png")
                browser.close()
        finally:
            serving.send_signal(signal.SIGINT)


if __name__ == "__main__":
    os.chdir(ROOT)
    make_live_pictures()
