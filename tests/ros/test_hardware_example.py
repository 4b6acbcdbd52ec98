"""The hardware example, launched for real: its drive answers, dies, recovers or is missing."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
import rclpy
from obelisk_sensor_msgs.msg import JointEncoders

from .stack import DEADLINE_S, eventually, launched, marked, obk

pytestmark = pytest.mark.ros

HARDWARE = Path(__file__).resolve().parents[2] / "examples" / "hardware"
CONFIG = HARDWARE / "hardware.yaml"
PACKAGE = HARDWARE / "src" / "udp_motor_robot"
USUAL_PORT = "47001"
ROBOT = "/obelisk_robot_0"
PATIENT = ("--set", "robot.params.drive_timeout_sec=3.0")
"""A generous timeout, because a busy machine may delay the drive; detection time is not tested."""


@contextmanager
def drive(port: int = 0) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """The simulated drive, and its port."""
    command = [sys.executable, HARDWARE / "device.py", "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, int(process.stdout.readline().rpartition(":")[2])
        finally:
            process.kill()


def at(port: int) -> tuple[str, ...]:
    return ("--set", f"robot.params.drive_port={port}", *PATIENT)


def states() -> dict[str, str]:
    return dict(json.loads(obk("lifecycle", "get", "--format", "json").stdout))


def free_port() -> int:
    with drive() as (_, port):
        return port


class Watcher:
    """Another program that observes the joint."""

    def __init__(self) -> None:
        rclpy.init()
        self.positions: list[float] = []
        self._node = rclpy.create_node("watcher")
        self._node.create_subscription(
            JointEncoders,
            "/hardware/joint_encoders",
            lambda message: self.positions.extend(message.y),
            10,
        )

    def wait_for_a_swing(self) -> None:
        """Wait until the joint has been on both sides of zero, like sin(t)."""
        self.positions.clear()

        def has_swung() -> bool:
            rclpy.spin_once(self._node, timeout_sec=0.1)
            if any(abs(position) > 1.1 for position in self.positions):
                self.positions.clear()  # it continued while a busy machine delayed its commands
            seen = self.positions or [0.0]
            return min(seen) < -0.8 and max(seen) > 0.8

        eventually(has_swung, "a swing of the joint")

    def close(self) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def watcher() -> Iterator[Watcher]:
    watcher = Watcher()
    yield watcher
    watcher.close()


def test_the_joint_follows_the_controller_and_nothing_is_left(watcher: Watcher) -> None:
    with drive() as (process, port):
        with launched(CONFIG, *at(port)) as run:
            watcher.wait_for_a_swing()
            run.process.send_signal(2)
            assert run.process.wait(DEADLINE_S) == 0, run.text
        assert not run.left_over()
        process.terminate()
        assert process.wait(DEADLINE_S) == 0
    assert not marked()


@pytest.mark.slow
def test_a_dead_drive_is_reported_and_the_robot_recovers_with_it(watcher: Watcher) -> None:
    with drive() as (process, port):
        with launched(CONFIG, *at(port)) as run:
            watcher.wait_for_a_swing()
            process.kill()
            process.wait()
            run.wait_for_line(f"the drive at 127.0.0.1:{port} has sent no new state for ")
            run.wait_for_line("continues without robot_0")
            others = {node: state for node, state in states().items() if node != ROBOT}
            assert set(others.values()) == {"active"}
            assert states()[ROBOT] == "unconfigured"
            refused = obk("lifecycle", "configure", "robot")
            assert refused.returncode == 1
            assert "within 1 s" in refused.stdout + refused.stderr
            with drive(port):
                # A busy machine may delay the drive's answer for more than its second.
                configure = ("lifecycle", "configure", "robot")
                eventually(lambda: obk(*configure).returncode == 0, "the robot, configured")
                result = obk("lifecycle", "activate", "robot")
                assert result.returncode == 0, result.stdout + result.stderr
                assert set(states().values()) == {"active"}
                watcher.wait_for_a_swing()
                run.process.send_signal(2)
                assert run.process.wait(DEADLINE_S) == 0, run.text
        assert not run.left_over()


@pytest.mark.slow
def test_a_dead_drive_stops_a_stack_that_is_to_stop() -> None:
    with drive() as (process, port):
        with launched(CONFIG, *at(port), "--set", "robot.on_crash=stop") as run:
            process.kill()
            assert run.process.wait(DEADLINE_S) == 1
        assert f"drive at 127.0.0.1:{port} " in run.cause, run.text
        assert not run.left_over()


@pytest.mark.slow
def test_without_a_drive_the_launch_fails_with_a_message_and_no_traceback() -> None:
    port = free_port()
    result = obk("launch", CONFIG, *at(port))
    assert result.returncode == 1
    assert "robot_0: configure FAILED" in result.stdout
    assert f"drive at 127.0.0.1:{port} " in result.stdout
    assert "`drive_host` and `drive_port`" in result.stdout
    assert "Traceback" not in result.stdout + result.stderr
    assert not marked()


@pytest.mark.slow
def test_the_packages_own_tests_pass() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=PACKAGE,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_the_demo_runs_to_its_end(tmp_path: Path) -> None:
    shutil.copytree(HARDWARE, tmp_path / "hardware")
    take_another_port(tmp_path)
    done = subprocess.run(
        [sys.executable, tmp_path / "hardware" / "demo.py", "1"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "stopped cleanly" in done.stdout
    assert "device: off after " in done.stdout
    assert not marked()


def test_a_killed_demo_leaves_neither_drive_nor_stack(tmp_path: Path) -> None:
    shutil.copytree(HARDWARE, tmp_path / "hardware")
    take_another_port(tmp_path)
    command = [sys.executable, tmp_path / "hardware" / "demo.py", "600"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as demo:
        assert demo.stdout is not None
        try:
            assert next(line for line in demo.stdout if line.startswith("device: listening"))
            drive, *_ = psutil.Process(demo.pid).children()
        finally:
            demo.kill()
    drive.wait(DEADLINE_S)
    eventually(lambda: not marked(), "the end of the stack")


def take_another_port(folder: Path) -> None:
    """Another test run may use the default port."""
    port = str(free_port())
    for path in (*folder.rglob("*.py"), *folder.rglob("*.yaml"), *folder.rglob("*.md")):
        path.write_text(path.read_text().replace(USUAL_PORT, port))
