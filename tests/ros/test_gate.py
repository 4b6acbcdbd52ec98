"""A process that waits at the gate is in the ROS domain, but its node is not."""

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
import rclpy

from obelisk_spec.runtime_protocol import GATE_VARIABLE
from obk_cli.launch.commands import closed_gate, gate_path
from obk_cli.ros.environment import ros_environment

from .stack import eventually

pytestmark = pytest.mark.ros

ESTIMATOR = (sys.executable, "-m", "obelisk_py.zoo.estimation")
NODE = "joint_encoders_passthrough_estimator"


def test_a_waiting_process_is_discovered_before_its_node_exists(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in ros_environment().variables.items():
        monkeypatch.setenv(name, value)
    variables = {**os.environ, GATE_VARIABLE: str(gate_path(tmp_path))}
    rclpy.init()
    observer = rclpy.create_node("observer")
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown)
        stack.callback(observer.destroy_node)
        with closed_gate(tmp_path):
            process = stack.enter_context(subprocess.Popen(ESTIMATOR, env=variables))
            stack.callback(process.terminate)
            hidden = f"_obelisk_{process.pid}"
            eventually(lambda: hidden in observer.get_node_names(), "the waiting process")
            assert set(observer.get_node_names()) == {"observer", hidden}
        eventually(lambda: NODE in observer.get_node_names(), "the node")
        eventually(lambda: hidden not in observer.get_node_names(), "the end of the hidden node")
    assert process.returncode == 0
