"""Shared code for the tests of composed processes: programs of nodes, and a process to run them."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor

from .stack import DEADLINE_S, DUMMY, eventually

NODES = """
import sys, time
import rclpy
from obelisk_py.core.node import ObeliskNode
from obelisk_py.core.utils.ros import spin_obelisk


class Reported(ObeliskNode):
    def __init__(self, node_name="reported"):
        super().__init__(node_name)
        self.declare_parameter("gain", 0)
        self.last_argument = sys.argv[-1]

    def report(self, what):
        print(self.get_name(), what, flush=True)

    def on_configure(self, state):
        self.get_logger().debug("a detail")
        self.report(self.get_parameter("gain").value)
        self.report(self.resolve_topic_name("in"))
        self.report(self.last_argument)
        return super().on_configure(state)

    def on_deactivate(self, state):
        self.report("deactivated")
        return super().on_deactivate(state)

    def on_shutdown(self, state):
        self.report("shut down")
        return super().on_shutdown(state)


class Act(Reported):
    "Does something in a callback once it is active."

    def on_activate(self, state):
        self.create_timer(0.01, self.act)
        return super().on_activate(state)


class Raising(Act):
    def act(self):
        raise ValueError("no such motor")


class Dying(Raising):
    def on_error(self, state):
        raise RuntimeError("nor is there a brake")


class Leaving(Act):
    def act(self):
        sys.exit(0)


class Stuck(Act):
    def act(self):
        self.report("stuck")
        time.sleep(1000)


class Unmade(Reported):
    def __init__(self):
        raise ValueError("no such port")


def main(args=None):
    spin_obelisk(args, Reported)

def held():
    print("opened", flush=True)
    try:
        spin_obelisk(sys.argv, Reported)
    finally:
        print("closed", flush=True)

def raising(): spin_obelisk(None, Raising)
def dying(): spin_obelisk(None, Dying)
def leaving(): spin_obelisk(None, Leaving)
def stuck(): spin_obelisk(None, Stuck)
def unmade(): spin_obelisk(None, Unmade)
def forgetful(): pass
def broken(): raise KeyError("no_such_key")
def own(args=None): rclpy.init(args=args)

if __name__ == "__main__":
    main()
"""

Entry = dict[str, Any]


def entry(
    node: str, function: str | None = "main", *arguments: str, module: str = "nodes"
) -> Entry:
    """A node of the plan with the ROS arguments that set its name."""
    namespace, name = node.rsplit("/", 1)
    names = ["-r", f"__node:={name}", *(["-r", f"__ns:={namespace}"] if namespace else [])]
    return {
        "node": node,
        "module": module,
        "function": function,
        "arguments": ["--ros-args", *names, *arguments],
    }


class Composed:
    """A composed process, its output, and a client for its services."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self.client = rclpy.create_node("client")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.client)
        self._clients: dict[str, Any] = {}

    @property
    def text(self) -> str:
        """The whole output."""
        return "\n".join(self.lines)

    def ask(self, kind: Any, name: str, request: Any) -> Any:
        """The response of a service; repeats the request, as the first response may get lost."""
        client = self._client(kind, name)
        while True:
            answer = client.call_async(request)
            self._executor.spin_until_future_complete(answer, timeout_sec=2.0)
            if answer.done():
                return answer.result()
            assert self.process.poll() is None, self.text

    def activate(self, *nodes: str) -> None:
        """Configure and activate."""
        for label, goal in (("configure", "inactive"), ("activate", "active")):
            for node in nodes:
                self._change(node, label)
                eventually(lambda node=node, goal=goal: self.state(node) == goal, f"{goal} {node}")

    def set_off(self, node: str) -> None:
        """Configure a node and request activation; the node may fail before it is seen active."""
        self._change(node, "configure")
        eventually(lambda: self.state(node) == "inactive", f"inactive {node}")
        self._change(node, "activate")

    def state(self, node: str) -> str:
        """The state of a node."""
        answer = self.ask(GetState, f"{node}/get_state", GetState.Request())
        return str(answer.current_state.label)

    def listen(self, kind: type[Any], topic: str) -> Callable[[], bool]:
        """Whether a message has arrived."""
        received: list[Any] = []
        self.client.create_subscription(kind, topic, received.append, 10)

        def has_arrived() -> bool:
            self._executor.spin_once(0.01)
            return bool(received)

        return has_arrived

    def wait_for_line(self, part: str) -> None:
        """Wait for a line with this text."""
        eventually(lambda: part in self.text, part, seen=lambda: self.text)

    def end(self, *signals: int) -> int:
        """The exit code after these signals."""
        for number in signals:
            self.process.send_signal(number)
        code = self.process.wait(DEADLINE_S)
        self.reader.join()
        return code

    def close(self) -> None:
        """Stop the process and clean up."""
        self.process.kill()
        self.end()
        self._executor.shutdown()
        self.client.destroy_node()

    def _change(self, node: str, label: str) -> None:
        request = ChangeState.Request()
        request.transition.label = label
        self._client(ChangeState, f"{node}/change_state").call_async(request)

    def _client(self, kind: Any, name: str) -> Any:
        if name not in self._clients:
            client = self.client.create_client(kind, name)
            assert client.wait_for_service(DEADLINE_S), f"no service {name}: {self.text}"
            self._clients[name] = client
        return self._clients[name]

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                self.lines.append(line.rstrip("\n"))


@contextmanager
def client_context() -> Iterator[list[Composed]]:
    """A list for processes, which are closed at the end; their clients share a context."""
    rclpy.init(args=[])
    made: list[Composed] = []
    try:
        yield made
    finally:
        for composed in made:
            composed.close()
        rclpy.try_shutdown()


def started_module(module: Sequence[str | Path], python_path: Path) -> "subprocess.Popen[str]":
    """Run a module, with an additional folder to import from."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *module],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONPATH": str(python_path)},
        cwd=DUMMY.parent,
    )
