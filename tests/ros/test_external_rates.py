"""Rates of nodes that do not report them, such as C++ nodes, are measured on their topics."""

from pathlib import Path

import pytest

from .stack import launched, obk
from .workspace import MANIFEST, write_files

pytestmark = pytest.mark.ros

FILES = {
    "plain/package.xml": MANIFEST.format("plain", ""),
    "plain/setup.py": """\
from setuptools import setup

setup(
    name="plain",
    packages=["plain"],
    entry_points={"console_scripts": ["controller = plain.controller:main"]},
)
""",
    "plain/plain/__init__.py": "",
    "plain/plain/controller.py": """\
import rclpy
from obelisk_control_msgs.msg import PositionSetpoint
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn


class Controller(LifecycleNode):
    def on_configure(self, state):
        self.pub = self.create_lifecycle_publisher(PositionSetpoint, "/arm/ctrl", 10)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        command = PositionSetpoint(u_mujoco=[0.0])
        self.timer = self.create_timer(PERIOD, lambda: self.pub.publish(command))
        return super().on_activate(state)


def main():
    rclpy.init()
    try:
        rclpy.spin(Controller("controller"))
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
""",
}
CONFIG = """\
config: plain
control:
  pkg: plain
  executable: controller
  publishers:
    - {key: pub_ctrl, topic: /arm/ctrl, msg_type: PositionSetpoint}
  timers:
    - {key: timer_ctrl, timer_period_sec: 0.5}
"""


def stack(folder: Path, period_s: float, timers: str = "") -> Path:
    """Return the config of a controller that publishes with this period; 0.5 s is expected."""
    program = FILES["plain/plain/controller.py"].replace("PERIOD", str(period_s))
    write_files(folder / "src", {**FILES, "plain/plain/controller.py": program})
    config = folder / "plain.yaml"
    config.write_text(CONFIG + timers)
    return config


def test_a_controller_that_is_too_slow_ends_a_strict_run(tmp_path: Path, ros_domain: int) -> None:
    config = stack(tmp_path, period_s=1.5)
    done = obk("launch", config, "--ignore", "OBK201", "--duration", "60", "--strict-rates")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "timer_ctrl runs at 0." in done.stdout


@pytest.mark.slow
def test_a_controller_that_keeps_its_rate_does_not(tmp_path: Path, ros_domain: int) -> None:
    with launched(stack(tmp_path, period_s=0.25), "--ignore", "OBK201", "--strict-rates") as run:
        run.wait_for_line("measured on its topics: timer_ctrl")
        with pytest.raises(AssertionError):
            run.wait_for_line("timer_ctrl runs at", deadline_s=8)
    assert run.process.returncode == 0, run.text


@pytest.mark.slow
def test_a_timer_that_no_topic_shows_ends_a_strict_run(tmp_path: Path, ros_domain: int) -> None:
    timers = "    - {key: timer_other, timer_period_sec: 0.5}\n"
    config = stack(tmp_path, period_s=0.5, timers=timers)
    done = obk("launch", config, "--ignore", "OBK201", "--duration", "60", "--strict-rates")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "not measured: timer_other" in done.stdout


SIMULATED = """\
robot:
  pkg: obelisk_sim_py
  executable: obelisk_mujoco_robot
  params: {realtime_factor: 0.25}
  subscribers:
    - {key: sub_ctrl, topic: /arm/ctrl, msg_type: PositionSetpoint}
  sim: {model_xml_path: bob.xml, n_u: 1, time_step: 0.002}
"""
BOB = """\
<mujoco>
  <worldbody>
    <body><joint name="slide" type="slide"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><motor name="push" joint="slide"/></actuator>
</mujoco>
"""


@pytest.mark.slow
@pytest.mark.mujoco
def test_the_rate_of_a_node_on_simulated_time_is_one_of_it(tmp_path: Path, ros_domain: int) -> None:
    """Simulated time runs at a quarter of wall time: 2 Hz of it are 0.5 Hz."""
    config = stack(tmp_path, period_s=0.5, timers=SIMULATED)
    (tmp_path / "bob.xml").write_text(BOB)
    with launched(config, "--ignore", "OBK201") as run:
        run.wait_for_line("measured on its topics: timer_ctrl")
        with pytest.raises(AssertionError):
            run.wait_for_line("timer_ctrl runs at", deadline_s=15)
    assert run.process.returncode == 0, run.text
