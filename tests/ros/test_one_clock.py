"""Stacks with a simulated robot use one clock for all nodes, under load and after a restart."""

import itertools
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from obelisk_sensor_msgs.msg import JointEncoders
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from .stack import DEADLINE_S, DUMMY, EXAMPLE, eventually, launched, obk

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

ENCODERS, DIAGNOSTICS = "/obelisk/dummy/joint_encoders", "/diagnostics"
DT_NS = 1_000_000
IN_1970_NS = 86_400 * 10**9
"""A limit between simulated time and wall time."""


class Listener:
    """A node not started by obk, on simulated time, and the stamps that it receives."""

    def __init__(self) -> None:
        parameters = [Parameter("use_sim_time", value=True)]
        self.node = rclpy.create_node("foreign", parameter_overrides=parameters)
        self.stamps: dict[str, list[int]] = {ENCODERS: [], DIAGNOSTICS: []}
        for topic, kind in ((ENCODERS, JointEncoders), (DIAGNOSTICS, DiagnosticArray)):
            self.node.create_subscription(kind, topic, self._keeping(topic), QoSProfile(depth=100))

    @property
    def now_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)

    def receive(self, topic: str, count: int) -> list[int]:
        """Stamps [ns] of further messages."""
        self.stamps[topic].clear()
        eventually(lambda: len(self.stamps[topic]) >= count, f"messages on {topic}")
        return self.stamps[topic][:count]

    def _keeping(self, topic: str) -> Any:
        def keep(message: Any) -> None:
            stamp = message.header.stamp
            self.stamps[topic].append(stamp.sec * 10**9 + stamp.nanosec)

        return keep


@pytest.fixture
def listener() -> Iterator[Listener]:
    rclpy.init()
    made, executor = Listener(), SingleThreadedExecutor()
    executor.add_node(made.node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield made
    executor.shutdown()
    thread.join()
    made.node.destroy_node()
    rclpy.try_shutdown()


def nodes_of_the_stack() -> list[dict[str, Any]]:
    """The nodes of the running stack, as `obk ps` prints them."""
    result = obk("ps", "--format", "json")
    assert result.returncode == 0, result.stderr
    (stack,) = json.loads(result.stdout)["stacks"]
    nodes: list[dict[str, Any]] = stack["nodes"]
    return nodes


def is_running(node: dict[str, Any], old_pid: int) -> bool:
    """Whether a node in a new process is active and keeps all its rates."""
    is_kept = node["rates"] and all(rate["standing"] == "kept" for rate in node["rates"])
    return node["pid"] != old_pid and node["state"] == "active" and bool(is_kept)


@contextmanager
def busy_machine() -> Iterator[None]:
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


@pytest.mark.parametrize("options", [(), pytest.param(("--composed",), marks=pytest.mark.slow)])
def test_stamps_are_exactly_a_period_apart_on_a_busy_machine(
    listener: Listener, options: tuple[str, ...]
) -> None:
    with launched(EXAMPLE, "--quiet", *options), busy_machine():
        stamps = listener.receive(ENCODERS, 300)
        # This node may miss messages, but no stamp is between two periods.
        assert all(stamp % DT_NS == 0 for stamp in stamps)
        assert all(later > earlier for earlier, later in itertools.pairwise(stamps))
        # Each node stamps its diagnostics by its own clock.
        assert all(0 < stamp < IN_1970_NS for stamp in listener.receive(DIAGNOSTICS, 6))
        eventually(lambda: 0 < listener.now_ns < IN_1970_NS, "the time on /clock")
        assert listener.node.count_subscribers("/clock") == 1  # this node itself


def test_the_key_selects_wall_time(listener: Listener) -> None:
    with launched(DUMMY, "--quiet", "--set", "obk.use_sim_time=false"):
        assert min(listener.receive(ENCODERS, 3)) > IN_1970_NS
        assert listener.node.count_publishers("/clock") == 0


def test_after_a_restart_of_the_simulator_nodes_follow_its_new_time(listener: Listener) -> None:
    with launched(DUMMY, "--on-crash", "restart") as run:
        # Longer than this process may need to discover the new simulator: it announces itself
        # every 3 s.
        eventually(lambda: listener.now_ns > 8 * 10**9, "eight seconds of simulated time")
        run.node("obelisk_robot_0").kill()
        for node in ("control_0", "estimation_0"):
            eventually(
                lambda node=node: any(  # type: ignore[misc]
                    line.startswith(node) and "simulated time jumped back" in line
                    for line in run.lines
                ),
                f"the jump back in {node}",
                seen=lambda: run.text,
            )
        eventually(
            lambda: any(
                later < earlier for earlier, later in itertools.pairwise(listener.stamps[ENCODERS])
            ),
            "stamps of the new time",
            seen=lambda: f"{run.text}\n{listener.stamps[ENCODERS][-30:]}",
        )


@pytest.mark.slow
def test_after_a_restart_of_a_composed_stack_time_and_timers_start_again(
    listener: Listener,
) -> None:
    with launched(DUMMY, "--composed", "--on-crash", "restart") as run:
        # Longer than this process may need to discover the new simulator: it announces itself
        # every 3 s.
        eventually(lambda: listener.now_ns > 8 * 10**9, "eight seconds of simulated time")
        (host,) = {node["pid"] for node in nodes_of_the_stack()}
        psutil.Process(host).kill()
        eventually(
            lambda: any(
                later < earlier for earlier, later in itertools.pairwise(listener.stamps[ENCODERS])
            ),
            "stamps of the new time",
            seen=lambda: run.text,
        )
        # Every node has restarted, and each timer runs at its rate.
        eventually(
            lambda: all(is_running(node, host) for node in nodes_of_the_stack()),
            "timers that run",
            seen=lambda: run.text,
        )
        set_back = [line for line in run.lines if "simulated time jumped back" in line]
        assert len(set_back) == 1, run.text


def test_nothing_is_left_of_a_launch_that_was_killed(tmp_path: Path) -> None:
    with launched(DUMMY, "--quiet") as run:
        left = set(run.descendants)
        psutil.Process(run.process.pid).kill()
        psutil.wait_procs(left, timeout=DEADLINE_S)
        assert not run.left_over()
    assert not [path for path in Path("/dev/shm").iterdir() if "obk" in path.name]
