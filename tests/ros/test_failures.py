"""Launches in which a transition hangs or raises, and ways to stop or replace such a launch."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from .stack import DEADLINE_S, DUMMY, OBK, eventually, launched, marked, obk, patient

pytestmark = pytest.mark.ros

CONTROLLER = '''\
"""A controller whose callback goes wrong."""

import time

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.control.example.example_position_setpoint_controller import (
    ExamplePositionSetpointController,
)


class Faulty(ExamplePositionSetpointController):
    def {callback}(self, state):
        print("the last words of the controller", flush=True)
        {what}


def main(args=None):
    spin_obelisk(args, Faulty)
'''
MANIFEST = '<package format="3"><name>faulty</name><version>0.1.0</version></package>\n'
SETUP = """\
from setuptools import setup

setup(
    name="faulty",
    packages=["faulty"],
    entry_points={"console_scripts": ["faulty = faulty.node:main"]},
)
"""


FAILS_ONCE = """\
        if not hasattr(self, "has_failed"):
            self.has_failed = False
            # Simulated time starts with the robot, perhaps after this node's activation.
            self.create_timer(0.001, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        return super().on_configure(state)

    def look(self):
        if not self.has_failed:
            self.has_failed = True
            time.sleep(1.0)  # until `activate` is requested
            raise ValueError("no gain")
""".lstrip()
STUCK_S = 6.0
"""Timeout of a transition, long enough for the other nodes on a busy machine."""


@pytest.fixture(autouse=True)
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OBK_HOME", str(tmp_path / "home"))


def with_faulty_controller(folder: Path, callback: str, what: str, dummy: Path = DUMMY) -> Path:
    """The dummy's config with a controller that executes code in a callback."""
    package = folder / "ws" / "src" / "faulty"
    (package / "faulty").mkdir(parents=True)
    (package / "package.xml").write_text(MANIFEST)
    (package / "setup.py").write_text(SETUP)
    (package / "faulty" / "__init__.py").write_text("")
    (package / "faulty" / "node.py").write_text(CONTROLLER.format(callback=callback, what=what))
    text = dummy.read_text().replace("dummy.xml", str(dummy.with_name("dummy.xml")))
    text = text.replace("params_path: dummy_params.txt", "")
    text = text.replace("pkg: obelisk_control_py", "pkg: faulty")
    config = folder / "ws" / "faulty.yaml"
    config.write_text(
        text.replace("executable: example_position_setpoint_controller", "executable: faulty")
    )
    return config


@pytest.mark.parametrize(
    "callback", ["on_configure", pytest.param("on_activate", marks=pytest.mark.slow)]
)
def test_a_stuck_transition_is_shown_with_its_location(tmp_path: Path, callback: str) -> None:
    config = with_faulty_controller(tmp_path, callback, "time.sleep(1000)")
    result = obk("launch", config, "--timeout", f"{STUCK_S:g}", "--quiet")
    assert result.returncode == 1, result.stdout
    name = callback.removeprefix("on_")
    assert f"control_0: {name} TIMED OUT" in result.stdout
    shown = result.stdout.partition("control_0: its last output:")[2]
    assert "the last words of the controller" in shown
    # What a busy machine has no time to show is in the log.
    (log,) = (tmp_path / "home" / "runs").glob("*/obelisk_control_0.log")
    assert f"in {callback}" in shown + log.read_text()
    failed = (
        f"failed: /obelisk_control_0: the transition `{name}` did not finish within {STUCK_S} s"
    )
    assert failed in result.stdout
    assert f"{config.name}:" in result.stdout.partition(failed)[2]
    assert not marked()


@pytest.mark.parametrize(
    "callback", ["on_configure", pytest.param("on_activate", marks=pytest.mark.slow)]
)
def test_a_raise_in_a_transition_is_shown_with_its_traceback_and_taken_back(
    tmp_path: Path, callback: str
) -> None:
    config = with_faulty_controller(tmp_path, callback, "raise ValueError('no gain')")
    result = obk("launch", config, "--quiet")
    assert result.returncode == 1, result.stdout
    name = callback.removeprefix("on_")
    shown = result.stdout.partition(f"control_0: {name} FAILED")[2]
    assert "Traceback " in shown
    assert "raise ValueError('no gain')" in shown
    assert shown.index("ValueError: no gain") < shown.index("rolling back")
    undone = {"configure": "cleanup", "activate": "deactivate"}[name]
    assert f"robot_0: {undone} ok" in shown.partition("rolling back")[2].partition("stopping")[0]
    assert "failed: /obelisk_control_0: " in shown


def test_a_node_that_fails_before_its_activation_is_restarted(tmp_path: Path) -> None:
    config = with_faulty_controller(tmp_path, "on_configure", FAILS_ONCE)
    text = config.read_text()
    rule = "executable: faulty\n      on_crash: restart"
    config.write_text(text.replace("executable: faulty", rule))
    result = obk("launch", config, "--quiet", "--duration", "2", "--ignore", "OBK")
    assert result.returncode == 0, result.stdout
    assert "control_0: restart 1 of 5" in result.stdout
    shown = result.stdout.partition("restart 1 of 5")[2]
    assert "control_0: activate ok" in shown.partition("stopping")[0]
    assert not marked()


def test_a_launcher_started_with_sigint_ignored_still_ends_at_sigint() -> None:
    """As a shell script starts background processes."""
    command = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", OBK]
    command += patient("launch", DUMMY, "--quiet")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        eventually(lambda: "s] active" in process.stdout.readline(), "a stack that is active")
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0
        assert process.stdout.read().splitlines()[-1] == "stopped cleanly"
    assert not marked()


@pytest.mark.parametrize(
    "is_stopped", [pytest.param(False, marks=pytest.mark.slow), True]
)  # as by Ctrl-Z
def test_a_launch_that_replaces_another_stops_it_cleanly_first(
    is_stopped: bool,
) -> None:
    with launched(DUMMY, "--quiet") as first:
        if is_stopped:
            os.kill(first.process.pid, signal.SIGSTOP)
        second = obk("launch", DUMMY, "--quiet", "--replace", "--duration", "0")
        assert second.returncode == 0, second.stdout + second.stderr
        assert first.process.wait(DEADLINE_S) == 0
    assert "stopping (replaced)" in first.text
    assert first.lines[-1] == "stopped cleanly"
    assert not first.left_over()
