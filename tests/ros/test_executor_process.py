"""Processes that run the executor shut down cleanly, whatever they left open."""

import re
import signal
import subprocess
import sys
import threading

import psutil
import pytest

from obelisk_py.core.time_slice import shorten_time_slice, time_slice_ns

from .stack import DEADLINE_S

pytestmark = pytest.mark.ros

WEAK_METHODS = re.compile(
    r"Exception ignored in: <function WeakMethod.*\nTraceback .*\n.*/weakref\.py.*\n"
    r"AttributeError: 'NoneType' object has no attribute '_alive'\n"
)
"""What CPython 3.13 writes at exit if a subclass of an rclpy executor that overrides `wake` was not
shut down."""
PREPARE = """
import rclpy, threading, time
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from obelisk_py.core.executor import EventLoopExecutor
"""
SPIN = """
rclpy.init()
node = Node("node")
executor = EventLoopExecutor({threads})
executor.add_node(node)
node.create_timer(0.001, lambda: None)
started = node.create_timer(0.05, lambda: (started.cancel(), print("ready", flush=True)))
try:
    executor.spin()
    print("over")
except KeyboardInterrupt:
    print("interrupted")
"""
FORGET = """
rclpy.init()
node = Node("node")
executor = EventLoopExecutor({threads})
executor.add_node(node)
node.create_timer(0.001, lambda: None)
threading.Thread(target=executor.spin, daemon=True).start()
time.sleep(0.1)
"""
CONTROLLER = """
import sys
from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk

class Controller(ObeliskController):
    def __init__(self):
        super().__init__("controller")
        self.ticks = 0
        self.create_timer(0.02, self.begin)

    def begin(self):
        if self.state_label == "unconfigured":
            self.trigger_configure()
            self.trigger_activate()

    def update_x_hat(self, x_hat_msg):
        pass

    def compute_control(self):
        self.ticks += 1
        if self.ticks == 20:
            print("ready", flush=True)

    def on_deactivate(self, state):
        print("deactivated", flush=True)
        return super().on_deactivate(state)

    def on_shutdown(self, state):
        print("shut down", flush=True)
        return super().on_shutdown(state)

spin_obelisk(sys.argv, Controller, {executor})
"""
SETTINGS = {
    "pub_ctrl_setting": "{topic: /c, msg_type: PositionSetpoint}",
    "sub_est_setting": "{topic: /e, msg_type: EstimatedState}",
    "timer_ctrl_setting": "{timer_period_sec: 0.001}",
}


def start(code: str, *args: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PREPARE + code, *args],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    try:
        output, errors = process.communicate(timeout=DEADLINE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        output, errors = process.communicate()
        pytest.fail(f"it did not end; it wrote: {output}{errors}")
    return process.returncode, output, WEAK_METHODS.sub("", errors)


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("number", "reported"), [(signal.SIGINT, "interrupted\n"), (signal.SIGTERM, "over\n")]
)
def test_rclpys_own_signal_handlers_end_spin(
    threads: int, number: signal.Signals, reported: str
) -> None:
    process = start(SPIN.format(threads=threads))
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    assert ended(process) == (0, reported, "")


@pytest.mark.parametrize("threads", [1, 2])
def test_a_process_that_shuts_nothing_down_ends_cleanly(threads: int) -> None:
    assert ended(start(FORGET.format(threads=threads))) == (0, "", "")


@pytest.mark.parametrize(
    "executor", ["None", "EventLoopExecutor", "SingleThreadedExecutor", "MultiThreadedExecutor"]
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_spin_obelisk_shuts_its_node_down_cleanly(executor: str, number: signal.Signals) -> None:
    settings = [a for name, value in SETTINGS.items() for a in ("-p", f"{name}:={value!r}")]
    process = start(CONTROLLER.format(executor=executor), "--ros-args", *settings)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    code, output, errors = ended(process)
    assert (code, output) == (0, "deactivated\nshut down\n"), errors


@pytest.mark.parametrize("end", ["0", "3"])
def test_an_exit_in_a_callback_shuts_the_node_down_and_is_reported(end: str) -> None:
    settings = [a for name, value in SETTINGS.items() for a in ("-p", f"{name}:={value!r}")]
    leaving = CONTROLLER.replace('print("ready", flush=True)', f"sys.exit({end})")
    process = start(leaving.format(executor="None"), "--ros-args", *settings)
    code, output, errors = ended(process)
    assert (code, output) == (int(end), "deactivated\nshut down\n"), errors
    assert "in compute_control" in errors
    assert errors.splitlines()[-1] == f"SystemExit: {end}"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_may_initialize_ros_before_it_calls_spin_obelisk(number: signal.Signals) -> None:
    settings = [a for name, value in SETTINGS.items() for a in ("-p", f"{name}:={value!r}")]
    code = "rclpy.init()" + CONTROLLER.format(executor="None")
    process = start(code, "--ros-args", *settings)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    returned, output, errors = ended(process)
    assert (returned, output) == (0, "deactivated\nshut down\n"), errors


CHILDREN = """
import multiprocessing, sys, time
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk

class Parent(ObeliskNode):
    def __init__(self):
        super().__init__("parent")
        processes = multiprocessing.get_context("fork").Process
        self.children = [processes(target=time.sleep, args=(60,), daemon=True) for _ in range(2)]
        for child in self.children:
            child.start()
        self.started = self.create_timer(0.1, self.end_one)

    def end_one(self):
        self.started.cancel()
        self.children[0].terminate()
        self.children[0].join(30)
        print("child", self.children[0].exitcode, flush=True)
        self.create_timer(0.2, lambda: print("ready", flush=True))

spin_obelisk([sys.argv[0]], Parent)
"""


def test_signals_to_children_of_a_node_and_to_the_node_concern_only_these() -> None:
    process = start(CHILDREN)
    assert process.stdout is not None
    assert process.stdout.readline() == f"child {-signal.SIGTERM}\n"
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert ended(process) == (0, "", "")


def test_only_the_spinning_thread_gets_short_time_slices() -> None:
    shortest_ns: list[int] = []

    def shorten() -> None:
        shorten_time_slice()
        shortest_ns.append(time_slice_ns())

    thread = threading.Thread(target=shorten)
    thread.start()
    thread.join()
    settings = [a for name, value in SETTINGS.items() for a in ("-p", f"{name}:={value!r}")]
    process = start(CONTROLLER.format(executor="None"), "--ros-args", *settings)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    own_ns = time_slice_ns()
    slices_ns = {one.id: time_slice_ns(one.id) for one in psutil.Process(process.pid).threads()}
    process.send_signal(signal.SIGTERM)
    ended(process)
    assert slices_ns.pop(process.pid) == shortest_ns[0]
    assert own_ns in slices_ns.values()
