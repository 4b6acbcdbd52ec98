"""A process that waits at the gate is not in the ROS domain."""

import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest
import rclpy

from obelisk_spec.runtime_protocol import GATE_VARIABLE
from obk_cli.launch.commands import closed_gate, gate_path
from obk_cli.ros.environment import ros_environment

from .stack import eventually

pytestmark = pytest.mark.ros

ESTIMATOR = (sys.executable, "-m", "obelisk_py.zoo.estimation")
NODE = "joint_encoders_passthrough_estimator"


def test_a_waiting_process_joins_the_domain_only_past_the_gate(
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
            eventually(lambda: waits_for_a_file_lock(process.pid), "the process at the gate")
            assert observer.get_node_names() == ["observer"]
            assert udp_sockets(process.pid) == 0
        eventually(lambda: NODE in observer.get_node_names(), "the node")
        assert udp_sockets(process.pid) > 0
    assert process.returncode == 0


def waits_for_a_file_lock(pid: int) -> bool:
    """Source: proc_locks(5)."""
    locks = Path("/proc/locks").read_text(encoding="ascii").splitlines()
    return any("->" in line and f" {pid} " in line for line in locks)


def udp_sockets(pid: int) -> int:
    return sum(one.type == socket.SOCK_DGRAM for one in psutil.Process(pid).net_connections("inet"))
