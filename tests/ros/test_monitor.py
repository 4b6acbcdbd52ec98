"""`obk monitor` on a running stack: as JSON, in a terminal, and without a local launcher."""

import json
import os
import select
import subprocess
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from .stack import DEADLINE_S, DUMMY, OBK, eventually, launched, obk

pytestmark = pytest.mark.ros

EST = "/obelisk/dummy/est"
IMU = "/obelisk/dummy/imu"
SECOND = ("--once", "--format", "json", "--period", "2")


def reported(*words: str, **variables: str) -> Any:
    result = obk("monitor", *words, env=variables)
    assert result.returncode == 0, (result.stdout, result.stderr)
    return json.loads(result.stdout)


def off(**variables: str) -> set[str]:
    return {topic["topic"] for topic in reported(*SECOND, **variables)["topics"] if topic["is_off"]}


@contextmanager
def throttled(process: psutil.Process) -> Iterator[None]:
    """A process that runs a tenth of the time."""
    is_over = threading.Event()

    def throttle() -> None:
        while not is_over.is_set():
            process.suspend()
            time.sleep(0.45)
            process.resume()
            time.sleep(0.05)

    thread = threading.Thread(target=throttle)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def test_a_stack_is_reported_with_its_nodes_and_rates_and_a_throttled_topic_is_marked() -> None:
    with launched(DUMMY, "--on-crash", "ignore") as run:
        view: dict[str, Any] = {}
        topics: dict[str, Any] = {}

        def keeps_its_rates() -> bool:
            view.update(reported(*SECOND))
            topics.update({topic["topic"]: topic for topic in view["topics"]})
            est = topics[EST]
            is_found = (est["publishers"], est["subscriptions"]) == (1, 1)
            is_counted = est["rate"] and est["rate"]["count"] > 5 and topics[IMU]["age"]
            is_kept = not any(topic["is_off"] for topic in view["topics"])
            # Without a state if the launcher did not reply in time.
            return bool(is_found and is_counted and is_kept and view["state"] == "active")

        eventually(keeps_its_rates, "a stack that keeps its rates")
        assert (view["name"], view["state"], view["has_ended"]) == ("dummy", "active", False)
        nodes = {node["node"]: node for node in view["nodes"]}
        estimation = run.node("obelisk_estimation_0")
        assert nodes["/obelisk_estimation_0"]["pid"] == estimation.pid
        assert nodes["/obelisk_robot_0"]["load"]["memory_bytes"] > 10_000_000
        assert topics[EST]["msg_type"] == "obelisk_estimator_msgs/msg/EstimatedState"
        # In wall time: a busy machine simulates slower than real time.
        assert 1 < topics[EST]["expected_hz"] <= 10.0
        assert topics[IMU]["age"]["p50_s"] < 60
        assert any("active" in line for line in view["lines"])
        assert f" {EST.rpartition('/')[2]} " in obk("monitor", "--once", "--period", "0.2").stdout
        with throttled(estimation):
            eventually(lambda: EST in off(), "the throttled topic")


@pytest.mark.slow
def test_each_period_is_a_line_until_the_stack_ends_and_then_nothing_runs() -> None:
    with launched(DUMMY) as run:
        monitor = subprocess.Popen(
            [OBK, "monitor", "--format", "json", "--run", "dummy"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert monitor.stdout is not None
        with monitor.stdout as lines:
            assert json.loads(lines.readline())["name"] == "dummy"
            run.process.send_signal(2)
            last = [json.loads(line) for line in lines][-1]
        assert monitor.wait(DEADLINE_S) == 0
    assert last["has_ended"]
    idle = obk("monitor", "--once", "--period", "0.2")
    assert idle.returncode == 1
    assert f"domain {os.environ['ROS_DOMAIN_ID']}" in idle.stderr
    in_a_pipe = obk("monitor")
    assert in_a_pipe.returncode == 2
    assert "`obk monitor --once`" in in_a_pipe.stderr


def test_a_stack_with_a_remote_launcher_is_reported_by_its_nodes(tmp_path: Path) -> None:
    elsewhere = {"OBK_HOME": str(tmp_path / "other_host")}
    seen: dict[str, Any] = {}

    def is_known() -> bool:
        seen.update(reported(*SECOND, **elsewhere))
        states = {node["node"]: node["state"] for node in seen["nodes"]}
        counts = {topic["topic"]: topic["rate"] for topic in seen["topics"]}
        is_active = states.get("/obelisk_control_0") == states.get("/dummy") == "active"
        return is_active and (counts.get(EST) or {"count": 0})["count"] > 2

    with launched(DUMMY):
        eventually(is_known, "the states of the nodes and the messages of a topic")
    assert (seen["run"], seen["name"], seen["lines"]) == ("", "", [])
    (est,) = (topic for topic in seen["topics"] if topic["topic"] == EST)
    assert est["expected_hz"] is None
    assert not est["is_off"]


class Screen:
    """A terminal in which a program can draw; its whole output is stored."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        termios.tcsetwinsize(self.slave, (24, 80))
        self.settings = termios.tcgetattr(self.slave)
        self.text = ""

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)

    def shows(self, words: str) -> bool:
        """Whether the program has printed this text."""
        while select.select([self.master], [], [], 0)[0]:
            self.text += os.read(self.master, 1 << 16).decode(errors="replace")
        return words in self.text

    def press(self, keys: str) -> None:
        self.text = ""
        os.write(self.master, keys.encode())


def test_in_a_terminal_it_shows_the_stack_takes_it_through_transitions_and_leaves_no_trace() -> (
    None
):
    with launched(DUMMY), closing(Screen()) as screen:
        process = subprocess.Popen(
            [OBK, "monitor"],
            stdin=screen.slave,
            stdout=screen.slave,
            stderr=screen.slave,
            env={**os.environ, "TERM": "xterm-256color"},
            start_new_session=True,
        )
        try:
            eventually(lambda: screen.shows("dummy  active"), "the stack's name and state")
            screen.press("d")
            eventually(lambda: screen.shows("deactivate all 3 nodes?"), "the question")
            screen.press("y")
            eventually(lambda: screen.shows("deactivate all nodes: done"), "the answer")
            eventually(lambda: screen.shows("dummy  inactive"), "the new state")
            screen.press("q")
            eventually(lambda: process.poll() is not None or screen.shows("\0"), "the end")
            assert process.returncode == 0
            assert screen.shows("\x1b[?1049l")  # back from the alternate screen
            assert screen.shows("\x1b[?25h")  # the cursor is visible
            assert termios.tcgetattr(screen.slave) == screen.settings
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            process.wait()
